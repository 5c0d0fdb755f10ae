// SPDX-License-Identifier: Apache-2.0
#include "server/admin/proposal_image.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

namespace cairn {
namespace {

std::vector<uint8_t> grey_png(int width, int height, uint8_t grey) {
  std::vector<uint8_t> png;
  EXPECT_TRUE(cv::imencode(".png", cv::Mat(height, width, CV_8UC1, cv::Scalar(grey)), png));
  return png;
}

TEST(ProposalImage, MarksWhatWasFoundAndWhatIsMissing) {
  const std::vector<MarkedPoint> points{{20, 20, true}, {50, 30, false}, {0, 0, false}, {63, 47, true}};
  const auto drawn = with_points(grey_png(64, 48, 100), points);
  ASSERT_TRUE(drawn) << drawn.error().message;
  const cv::Mat image = cv::imdecode(*drawn, cv::IMREAD_COLOR);
  ASSERT_EQ(image.size(), cv::Size(64, 48));
  const auto at = [&](int x, int y) { return image.at<cv::Vec3b>(y, x); };
  EXPECT_EQ(at(20, 20), cv::Vec3b(100, 100, 100)) << "what a square surrounds is seen";
  EXPECT_GT(at(17, 20)[1], at(17, 20)[2]) << "green";
  EXPECT_GT(at(50, 30)[2], at(50, 30)[1]) << "red";
  EXPECT_GT(at(0, 0)[2], at(0, 0)[1]);
  EXPECT_EQ(at(40, 40), cv::Vec3b(100, 100, 100));
}

TEST(ProposalImage, WhatIsNoImageIsRefused) {
  const std::vector<uint8_t> nonsense(100, 7);
  const auto drawn = with_points(nonsense, {});
  ASSERT_FALSE(drawn);
  EXPECT_EQ(drawn.error().code, ErrorCode::kDamaged);
}

}  // namespace
}  // namespace cairn
