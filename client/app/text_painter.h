// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <string>

namespace cairn {

class UnicodeFonts;

/// Text in an image. ASCII is drawn with OpenCV's own strokes; anything else with a font of this machine
/// that has its letters, found when it is first needed. A letter that no font has, or any beyond ASCII in a
/// build without fonts (client/app/REFERENCE.md), is one `?`. Used from one thread.
class TextPainter {
 public:
  TextPainter();
  ~TextPainter();
  TextPainter(TextPainter&&) noexcept;
  TextPainter& operator=(TextPainter&&) noexcept;

  /// [px] `scale` is that of OpenCV's FONT_HERSHEY_SIMPLEX. Width, and height above the baseline.
  [[nodiscard]] cv::Size size(const std::string& text, double scale, int thickness = 1) const;
  /// `baseline`: where the text begins. `image`: BGR.
  void draw(const std::string& text, cv::Point baseline, double scale, const cv::Scalar& ink, cv::Mat* image,
            int thickness = 1) const;

 private:
  std::unique_ptr<UnicodeFonts> fonts_;
};

}  // namespace cairn
