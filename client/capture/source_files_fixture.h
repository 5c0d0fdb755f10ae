// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "client/capture/frame_source.h"
#include "common/io/test_directory.h"

/// Recordings that a test of sources writes, and what their frames say.
namespace cairn {

namespace fs = std::filesystem;

inline constexpr int kWidth = 64;
inline constexpr int kHeight = 48;

/// An image that says which frame it is, also after lossy coding.
inline cv::Mat numbered_image(int number) {
  return {kHeight, kWidth, CV_8U, cv::Scalar(20 * number + 10)};
}
inline int number_of(const Frame& frame) {
  return frame.image->row(kHeight / 2)[kWidth / 2] / 20;
}

class FrameSourceFiles : public ::testing::Test {
 protected:
  void write_image(const std::string& name, int number) {
    const auto path = dir() / name;
    fs::create_directories(path.parent_path());
    ASSERT_TRUE(cv::imwrite(path.string(), numbered_image(number)));
  }
  void write_text(const std::string& name, const std::string& content) {
    std::ofstream(dir() / name) << content;
  }
  void write_video(const std::string& name, int frames, double fps = 20) {
    cv::VideoWriter writer((dir() / name).string(), cv::CAP_FFMPEG,
                           cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), fps, {kWidth, kHeight}, false);
    ASSERT_TRUE(writer.isOpened());
    for (int i = 0; i < frames; ++i) writer.write(numbered_image(i));
  }
  [[nodiscard]] std::string uri(const std::string& scheme, const std::string& rest = "") const {
    return scheme + ":" + dir().string() + rest;
  }
  [[nodiscard]] const fs::path& dir() const { return directory_.path(); }

  struct Taken {
    std::vector<Frame> frames;
    std::vector<std::string> errors;
  };
  static Taken take_all(FrameSource& source) {
    Taken taken;
    for (int calls = 0; calls < 100; ++calls) {
      auto item = source.next();
      if (!item) {
        taken.errors.push_back(item.error().message);
      } else if (!*item) {
        return taken;
      } else {
        taken.frames.push_back(**item);
      }
    }
    ADD_FAILURE() << "the source does not end";
    return taken;
  }
  static void expect_open_error(const std::string& uri, ErrorCode code, const std::string& part) {
    const auto source = open_source(uri);
    ASSERT_FALSE(source) << uri;
    EXPECT_EQ(source.error().code, code) << source.error().message;
    EXPECT_THAT(source.error().message, ::testing::HasSubstr(part));
  }

 private:
  TestDirectory directory_;
};

}  // namespace cairn
