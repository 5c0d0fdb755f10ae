// SPDX-License-Identifier: Apache-2.0
#include "client/session/image_encoder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace cairn {
namespace {

GrayImage waves(int width, int height) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      image.row(y)[x] = static_cast<uint8_t>(128 + 100 * std::sin(0.2 * x) * std::cos(0.1 * y));
  }
  return image;
}

TEST(ImageEncoder, RawIsTheRowsWithoutPadding) {
  const GrayImage image = waves(101, 37);
  const wire::ImageMessage message = encode_image(image, wire::ImageEncoding::kRaw);
  ASSERT_EQ(message.bytes.size(), 101U * 37U);
  for (int y = 0; y < 37; ++y) {
    for (int x = 0; x < 101; ++x) ASSERT_EQ(message.bytes[static_cast<size_t>(y * 101 + x)], image.row(y)[x]);
  }
}

TEST(ImageEncoder, JpegIsSmallerAndCloseToTheImage) {
  const GrayImage image = waves(101, 37);
  const wire::ImageMessage message = encode_image(image, wire::ImageEncoding::kJpeg);
  EXPECT_EQ(message.width, 101U);
  EXPECT_EQ(message.height, 37U);
  EXPECT_LT(message.bytes.size(), 101U * 37U);
  const cv::Mat decoded = cv::imdecode(message.bytes, cv::IMREAD_GRAYSCALE);
  ASSERT_EQ(decoded.cols, 101);
  ASSERT_EQ(decoded.rows, 37);
  for (int y = 0; y < 37; ++y) {
    for (int x = 0; x < 101; ++x) ASSERT_LE(std::abs(decoded.at<uint8_t>(y, x) - image.row(y)[x]), 12);
  }
}

}  // namespace
}  // namespace cairn
