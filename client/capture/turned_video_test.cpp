// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <iterator>

#include "client/capture/source_files_fixture.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// The first four numbers of a track header's matrix (ISO 14496-12, 8.3.2): x' = a x + c y, y' = b x + d y,
/// y downwards.
struct Turn {
  int degrees;  ///< clockwise, as players show it
  std::array<int32_t, 4> abcd;
  std::array<int, 4> quadrants;  ///< upper left, upper right, lower left, lower right, when shown
};
const std::array kTurns = {Turn{0, {1, 0, 0, 1}, {0, 1, 2, 3}}, Turn{90, {0, 1, -1, 0}, {2, 0, 3, 1}},
                           Turn{180, {-1, 0, 0, -1}, {3, 2, 1, 0}}, Turn{270, {0, -1, 1, 0}, {1, 3, 0, 2}}};

class TurnedVideo : public FrameSourceFiles {
 protected:
  /// A video whose quadrants have the numbers 0 to 3, kept as the sensor sees it and said to be turned.
  void write_turned(const Turn& turn) {
    const auto path = (dir() / "v.mp4").string();
    cv::Mat quadrants(kHeight, kWidth, CV_8UC3);
    for (int i = 0; i < 4; ++i) {
      const cv::Rect part(i % 2 * kWidth / 2, i / 2 * kHeight / 2, kWidth / 2, kHeight / 2);
      quadrants(part).setTo(cv::Scalar::all(60 * i + 30));
    }
    {
      cv::VideoWriter writer(path, cv::CAP_FFMPEG, cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 20,
                             {kWidth, kHeight});
      ASSERT_TRUE(writer.isOpened());
      for (int i = 0; i < 3; ++i) writer.write(quadrants);
    }
    std::ifstream file(path, std::ios::binary);
    std::string bytes(std::istreambuf_iterator<char>(file), {});
    const size_t header = bytes.find("tkhd");
    ASSERT_NE(header, std::string::npos);
    for (size_t i = 0; i < 4; ++i) {
      const auto fixed = static_cast<uint32_t>(turn.abcd[i] * 65536);
      const size_t at = header + 4 + 40 + 4 * (i < 2 ? i : i + 1);  // rows of three
      for (size_t byte = 0; byte < 4; ++byte) bytes[at + byte] = static_cast<char>(fixed >> (24 - 8 * byte));
    }
    std::ofstream(path, std::ios::binary) << bytes;
  }
  static std::vector<int> quadrants_of(const GrayImage& image) {
    std::vector<int> numbers;
    for (int i = 0; i < 4; ++i)
      numbers.push_back(image.row(image.height() * (1 + i / 2 * 2) / 4)[image.width() * (1 + i % 2 * 2) / 4] /
                        60);
    return numbers;
  }
};

TEST_F(TurnedVideo, IsShownAsPlayersDo) {
  for (const Turn& turn : kTurns) {
    SCOPED_TRACE(turn.degrees);
    write_turned(turn);
    const auto source = open_source(uri("video", "/v.mp4"));
    ASSERT_TRUE(source) << source.error().message;
    const bool is_upright = turn.degrees % 180 == 90;
    const ImageSize size = is_upright ? ImageSize{kHeight, kWidth} : ImageSize{kWidth, kHeight};
    EXPECT_EQ((*source)->image_size(), size);
    const auto notes = (*source)->notes();
    ASSERT_EQ(notes.size(), turn.degrees == 0 ? 0U : 1U);
    if (!notes.empty()) {
      EXPECT_THAT(notes[0].text, AllOf(HasSubstr("v.mp4"), HasSubstr("by " + std::to_string(turn.degrees))));
    }
    const auto frames = take_all(**source).frames;
    ASSERT_EQ(frames.size(), 3U);
    for (const auto& frame : frames) {
      EXPECT_EQ(frame.image->width(), size.width);
      EXPECT_EQ(frame.image->height(), size.height);
      EXPECT_EQ(quadrants_of(*frame.image), std::vector(turn.quadrants.begin(), turn.quadrants.end()));
    }
  }
}

TEST_F(TurnedVideo, ACalibrationIsForTheUprightImage) {
  write_turned(kTurns[1]);
  const auto source = open_source(uri("video", "/v.mp4"));
  ASSERT_TRUE(source) << source.error().message;
  CameraParameters calibration;
  const auto fit = [&](int width, int height) {
    calibration.width = width;
    calibration.height = height;
    return check_image_size(**source, calibration);
  };
  EXPECT_TRUE(fit(kHeight, kWidth));
  const auto exchanged = fit(kWidth, kHeight);
  ASSERT_FALSE(exchanged);
  EXPECT_EQ(exchanged.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(exchanged.error().message, HasSubstr("width and height exchanged"));
  const auto other = fit(kWidth, kWidth);
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message, Not(HasSubstr("exchanged")));
}

}  // namespace
}  // namespace cairn
