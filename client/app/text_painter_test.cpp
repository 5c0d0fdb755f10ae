// SPDX-License-Identifier: Apache-2.0
#include "client/app/text_painter.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "client/app/unicode_fonts.h"

namespace cairn {
namespace {

constexpr double kScale = 0.5;
const cv::Scalar kPaper(10, 10, 10);
const cv::Scalar kInk(250, 250, 250);

cv::Mat drawn(const std::string& text) {
  cv::Mat image(60, 300, CV_8UC3, kPaper);
  TextPainter().draw(text, {20, 40}, kScale, kInk, &image);
  return image;
}

bool is_equal(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_L1) == 0;
}

/// What was painted on, in pixels.
cv::Rect inked(const cv::Mat& image) {
  cv::Mat grey;
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  return cv::boundingRect(grey > 60);
}

/// A private one: no font of this machine has it.
const std::string kUnknown = "\U0010fff0";

TEST(TextPainter, AsciiIsDrawnAsOpenCvDoes) {
  cv::Mat expected(60, 300, CV_8UC3, kPaper);
  cv::putText(expected, "drill #2", {20, 40}, cv::FONT_HERSHEY_SIMPLEX, kScale, kInk, 1, cv::LINE_AA);
  EXPECT_TRUE(is_equal(drawn("drill #2"), expected));
}

TEST(TextPainter, WhatItSaysOfTheSizeIsWhatItDraws) {
  for (const std::string text : {"drill", "Küche", "стол", "Αθήνα"}) {
    const cv::Size size = TextPainter().size(text, kScale);
    const cv::Rect box = inked(drawn(text));
    EXPECT_NEAR(box.width, size.width, 6) << text;
    EXPECT_NEAR(box.x, 20, 4) << text;
    EXPECT_GT(box.y, 40 - size.height - 4) << text;
    EXPECT_NEAR(box.br().y, 40, 6) << text << " stands on its baseline";
  }
}

TEST(TextPainter, WithoutAFontALetterIsOneQuestionMark) {
  UnicodeFonts fonts;
  if (!fonts.size("ü", 15)) {  // a build, or a machine, without
    EXPECT_TRUE(is_equal(drawn("Küche"), drawn("K?che")));
    EXPECT_TRUE(is_equal(drawn("Ku\u0308che"), drawn("K?che")));
  }
  EXPECT_TRUE(is_equal(drawn(kUnknown + "\u0308"), drawn(kUnknown)));
  EXPECT_FALSE(is_equal(drawn(kUnknown), drawn("")));
}

TEST(TextPainter, WithAFontLettersBeyondAsciiAreThemselves) {
  UnicodeFonts fonts;
  if (!fonts.size("ü", 15)) GTEST_SKIP() << "no freetype module or no font here";
  EXPECT_FALSE(is_equal(drawn("ü"), drawn("ö")));
  EXPECT_FALSE(is_equal(drawn("ü"), drawn(kUnknown)));
  EXPECT_FALSE(is_equal(drawn("ж"), drawn(kUnknown)));
}

}  // namespace
}  // namespace cairn
