// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_sample.h"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>

#include "client/capture/source_files_fixture.h"
#include "common/io/test_exif.h"

namespace cairn {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// Each of these values once in a hundred, and a few faults of the sensor.
DeepHistogram histogram_of(int first, int last) {
  DeepHistogram histogram(65536);
  for (int value = first; value <= last; ++value) histogram[static_cast<size_t>(value)] = 100;
  histogram[0] += 1;
  histogram[65535] += 1;
  return histogram;
}

void expect_levels(const std::optional<GrayLevels>& levels, int black, int white) {
  ASSERT_TRUE(levels);
  EXPECT_EQ(levels->black, black);
  EXPECT_EQ(levels->white, white);
}

TEST(UsedLevels, AreThoseOfTheBitsOfASensor) {
  for (const int bits : {8, 10, 12, 14}) {
    SCOPED_TRACE(bits);
    const int white = (1 << bits) - 1;
    expect_levels(used_levels(histogram_of(1, white)), 0, white);
    expect_levels(used_levels(histogram_of(white / 20, white * 3 / 4)), 0, white);
  }
  EXPECT_FALSE(used_levels(histogram_of(1, 65535)));
  EXPECT_FALSE(used_levels(histogram_of(300, 40000)));
  EXPECT_FALSE(used_levels(DeepHistogram(65536)));
}

TEST(UsedLevels, ANarrowPartOfThemIsStretched) {
  const auto levels = used_levels(histogram_of(29000, 31000));  // hundredths of a kelvin
  ASSERT_TRUE(levels);
  EXPECT_NEAR(levels->black, 28000, 10);
  EXPECT_NEAR(levels->white, 32000, 10);
}

/// A ramp with some texture in the lower `bits`, brighter by `offset`.
cv::Mat deep_image(int bits, int offset) {
  cv::Mat image(kHeight, kWidth, CV_16U);
  const int most = (1 << bits) - 1;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const int texture = (5 * x * x + 3 * y * y) % 251 * most / 16383;
      const int value = most * x / kWidth + offset + texture;
      image.at<uint16_t>(y, x) = static_cast<uint16_t>(std::min(most, value));
    }
  }
  return image;
}

class DeepImages : public FrameSourceFiles {
 protected:
  void write_recording(int bits, const std::string& extension) {
    for (int i = 0; i < 12; ++i)
      ASSERT_TRUE(cv::imwrite((dir() / (std::to_string(i) + extension)).string(), deep_image(bits, i)));
  }
  /// The largest difference of the frames from their deep images with all bits used [grey values].
  int largest_difference(int bits) {
    const auto source = open_source(uri("images"));
    EXPECT_TRUE(source) << source.error().message;
    const auto frames = take_all(**source).frames;
    EXPECT_EQ(frames.size(), 12U);
    int largest = 0;
    for (size_t i = 0; i < frames.size(); ++i) {
      const cv::Mat deep = deep_image(bits, static_cast<int>(i));
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) {
          const int wanted = deep.at<uint16_t>(y, x) >> (bits - 8);
          largest = std::max(largest, std::abs(frames[i].image->row(y)[x] - wanted));
        }
      }
    }
    return largest;
  }
};

TEST_F(DeepImages, FewerBitsThanTheFileHasAreReadAsAllOfTheRange) {
  for (const std::string extension : {".png", ".pgm"}) {
    for (const int bits : {10, 12, 14, 16}) {
      write_recording(bits, extension);
      EXPECT_LE(largest_difference(bits), 1) << bits << extension;
      const auto notes = (*open_source(uri("images")))->notes();
      ASSERT_EQ(notes.size(), bits == 16 ? 0U : 1U) << bits << extension;
      const std::string levels = "values 0 to " + std::to_string((1 << bits) - 1) + " of 65535";
      for (const auto& note : notes) EXPECT_THAT(note.text, HasSubstr(levels));
    }
    for (int i = 0; i < 12; ++i) fs::remove(dir() / (std::to_string(i) + extension));
  }
}

TEST_F(DeepImages, OneMappingServesAllOfARecording) {
  for (int i = 0; i < 20; ++i) {  // the light goes down; one grey stays
    cv::Mat image = deep_image(12, 0) / (1 + i);
    image.at<uint16_t>(5, 5) = 1600;
    ASSERT_TRUE(cv::imwrite((dir() / (std::to_string(i) + ".png")).string(), image));
  }
  const auto source = open_source(uri("images"));
  ASSERT_TRUE(source) << source.error().message;
  for (const auto& frame : take_all(**source).frames) EXPECT_EQ(frame.image->row(5)[5], 100) << frame.index;
}

TEST_F(DeepImages, ThoseOfTheListsToo) {
  write_recording(12, ".png");
  write_text("rgb.txt", "0 0.png\n0.1 1.png\n");
  const auto source = open_source(uri("tum"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->notes().size(), 1U);
}

TEST_F(DeepImages, LowBytesFirstAreNoticed) {
  for (const int bits : {12, 16}) {
    for (int i = 0; i < 12; ++i) {
      const cv::Mat image = deep_image(bits, i);
      std::ofstream file(dir() / (std::to_string(i) + ".pgm"), std::ios::binary);
      file << "P5\n" << kWidth << " " << kHeight << "\n65535\n";
      file.write(reinterpret_cast<const char*>(image.data), std::streamsize{2} * kWidth * kHeight);
    }
    EXPECT_LE(largest_difference(bits), 1) << bits;
    EXPECT_THAT((*open_source(uri("images")))->notes().at(0).text, HasSubstr("low byte first"));
  }
}

TEST(ExchangedBytes, AreNotSuspectedInImagesOfEightBitsTimes256) {
  DeepImage image{kWidth, kHeight, {}};
  const cv::Mat deep = deep_image(8, 0);
  for (auto at = deep.begin<uint16_t>(); at != deep.end<uint16_t>(); ++at)
    image.pixels.push_back(static_cast<uint16_t>(*at << 8));
  EXPECT_FALSE(has_exchanged_bytes(image));
}

class HeldImages : public FrameSourceFiles {
 protected:
  void write_held(const std::string& name, int orientation) {
    const auto jpeg = jpeg_held(numbered_image(1), orientation);
    std::ofstream(dir() / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(jpeg.data()), std::ssize(jpeg));
  }
};

TEST_F(HeldImages, AreUprightAndTheLogSaysSo) {
  for (int i = 0; i < 3; ++i) write_held(std::to_string(i) + ".jpg", 6);
  const auto source = open_source(uri("images"));
  ASSERT_TRUE(source) << source.error().message;
  const ImageSize size{kHeight, kWidth};
  EXPECT_EQ((*source)->image_size(), size);
  const auto notes = (*source)->notes();
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_FALSE(notes[0].is_warning);
  EXPECT_THAT(notes[0].text, AllOf(HasSubstr("turned by 90 degrees clockwise"), HasSubstr("48x64")));
  const auto taken = take_all(**source);
  EXPECT_EQ(taken.frames.size(), 3U);
  for (const auto& frame : taken.frames) EXPECT_EQ(frame.image->width(), kHeight);
}

TEST_F(HeldImages, InSeveralWaysAreWarnedOf) {
  write_held("0.jpg", 6);
  write_held("1.jpg", 8);
  write_held("2.jpg", 8);
  const auto notes = (*open_source(uri("images")))->notes();
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_TRUE(notes[0].is_warning);
  EXPECT_THAT(notes[0].text, AllOf(HasSubstr("by 90 degrees"), HasSubstr("by 270 degrees")));
}

TEST_F(DeepImages, ImagesOfEightBitsStayAsTheyAre) {
  for (int i = 0; i < 3; ++i) write_image(std::to_string(i) + ".png", 0);
  const auto source = open_source(uri("images"));
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_TRUE((*source)->notes().empty());
  EXPECT_EQ(take_all(**source).frames.at(0).image->row(0)[0], 10);
}

}  // namespace
}  // namespace cairn
