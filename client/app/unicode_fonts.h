// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

namespace cairn {

/// The fonts of this machine, as fontconfig knows them, drawn by OpenCV's freetype module. A build without
/// either has none (no_unicode_fonts.cpp). Used from one thread.
class UnicodeFonts {
 public:
  UnicodeFonts();
  ~UnicodeFonts();
  UnicodeFonts(const UnicodeFonts&) = delete;
  UnicodeFonts& operator=(const UnicodeFonts&) = delete;

  /// `height`: of a line [px]. Letters that the font chosen for `text` has not are `?`. Nothing: no font.
  [[nodiscard]] std::optional<cv::Size> size(const std::string& text, int height);
  /// Draws a text with its baseline at a place. False, and nothing is drawn, where there is no font.
  bool draw(const std::string& text, cv::Point baseline, int height, const cv::Scalar& ink, cv::Mat* image);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn
