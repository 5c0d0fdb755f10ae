// SPDX-License-Identifier: Apache-2.0
#include "client/app/text_painter.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "client/app/unicode_fonts.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

constexpr int kStrokes = cv::FONT_HERSHEY_SIMPLEX;
constexpr double kLineHeight = 29;  ///< [px] of other fonts at scale 1: capitals are as high as OpenCV's

bool is_ascii(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= 0x20 && c <= 0x7e; });
}

int line_height(double scale) {
  return std::max(1, static_cast<int>(std::lround(kLineHeight * scale)));
}

std::string with_question_marks(const std::string& text) {
  std::string ascii;
  for (const std::string_view letter : letters(text)) {
    if (is_ascii(letter))
      ascii += letter;
    else
      ascii += '?';
  }
  return ascii;
}

}  // namespace

TextPainter::TextPainter() : fonts_(std::make_unique<UnicodeFonts>()) {}
TextPainter::~TextPainter() = default;
TextPainter::TextPainter(TextPainter&&) noexcept = default;
TextPainter& TextPainter::operator=(TextPainter&&) noexcept = default;

cv::Size TextPainter::size(const std::string& text, double scale, int thickness) const {
  if (!is_ascii(text)) {
    if (const auto found = fonts_->size(one_line(text), line_height(scale))) return *found;
  }
  int below = 0;
  return cv::getTextSize(with_question_marks(text), kStrokes, scale, thickness, &below);
}

void TextPainter::draw(const std::string& text, cv::Point baseline, double scale, const cv::Scalar& ink,
                       cv::Mat* image, int thickness) const {
  if (!is_ascii(text) && fonts_->draw(one_line(text), baseline, line_height(scale), ink, image)) return;
  cv::putText(*image, with_question_marks(text), baseline, kStrokes, scale, ink, thickness, cv::LINE_AA);
}

}  // namespace cairn
