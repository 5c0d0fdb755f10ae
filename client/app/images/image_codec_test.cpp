// SPDX-License-Identifier: Apache-2.0
#include "client/app/images/image_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace cairn {
namespace {

/// What no encoder makes small.
cv::Mat noise(int width, int height) {
  cv::Mat pixels(height, width, CV_8UC3);
  cv::RNG random(7);
  random.fill(pixels, cv::RNG::UNIFORM, 0, 256);
  return pixels;
}

TEST(ImageCodec, AnImageComesAsItWentWhereItFits) {
  cv::Mat pixels(480, 640, CV_8UC3, cv::Scalar(40, 90, 160));
  cv::circle(pixels, {200, 150}, 60, {200, 220, 30}, -1);
  const auto message = encode_camera_image(pixels);
  EXPECT_EQ(message.encoding, wire::ImageEncoding::kJpeg);
  const auto decoded = decode_camera_image(message);
  ASSERT_TRUE(decoded.has_value()) << decoded.error().message;
  ASSERT_EQ(decoded->size(), pixels.size());
  EXPECT_LT(cv::norm(*decoded, pixels, cv::NORM_L1) / static_cast<double>(3 * pixels.total()), 3);
}

TEST(ImageCodec, WhateverItShowsAnImageIsWithinItsBounds) {
  for (const cv::Size size :
       {cv::Size(640, 480), cv::Size(1920, 1080), cv::Size(480, 2000), cv::Size(1, 4096)}) {
    const auto message = encode_camera_image(noise(size.width, size.height));
    EXPECT_LE(message.bytes.size(), wire::kMaxCameraImageBytes) << size;
    EXPECT_LE(std::max(message.width, message.height), wire::kMaxCameraImageSide) << size;
    const auto decoded = decode_camera_image(message);
    ASSERT_TRUE(decoded.has_value()) << decoded.error().message;
    EXPECT_EQ(decoded->cols, static_cast<int>(message.width));
    const double shape = static_cast<double>(size.width) / size.height;
    EXPECT_NEAR(static_cast<double>(decoded->cols) / decoded->rows, shape, 0.02 * shape + 0.01) << size;
  }
}

TEST(ImageCodec, WhatIsNoImageOfItsSizeIsRefused) {
  const auto good = encode_camera_image(noise(64, 48));
  auto cut = good;
  cut.bytes.resize(cut.bytes.size() / 2);
  EXPECT_FALSE(decode_camera_image(cut));
  auto larger = good;
  larger.width = 32;
  EXPECT_FALSE(decode_camera_image(larger)) << "memory is taken by what is said";
  auto other = good;
  other.bytes = {1, 2, 3};
  EXPECT_FALSE(decode_camera_image(other));
}

TEST(ImageCodec, StatesGoAndComeBack) {
  for (const FrameState state : {FrameState::kStarting, FrameState::kTracking, FrameState::kPoor,
                                 FrameState::kLost, FrameState::kRotation})
    EXPECT_EQ(frame_state_of(tracking_state_of(state)), state);
}

}  // namespace
}  // namespace cairn
