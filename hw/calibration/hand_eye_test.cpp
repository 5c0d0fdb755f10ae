// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/hand_eye.h"

#include <gmock/gmock.h>

#include <random>
#include <string>
#include <vector>

#include "common/geometry/se3.h"

namespace cairn {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kDegree = M_PI / 180;

class HandEyeTest : public ::testing::Test {
 protected:
  /// With a tracker's noise, and encoders behind 0.3 degrees of backlash.
  std::vector<Glance> glances(size_t count, double range = 0.6) {
    std::uniform_real_distribution<double> unit(-1, 1);
    std::normal_distribution<double> noise(0, 1);
    const auto any = [&](double size) -> Vector3d {
      return size * Vector3d{noise(random_), noise(random_), noise(random_)};
    };
    std::vector<Glance> all;
    for (size_t i = 0; i < count; ++i) {
      const PanTilt axes{range * unit(random_), 0.7 * range * unit(random_)};
      const Quaterniond head = truth_.map_from_base * base_from_head(axes);
      all.push_back({{axes.pan + 0.15 * kDegree * unit(random_), axes.tilt + 0.15 * kDegree * unit(random_)},
                     head * truth_.head_from_camera * so3_exp(any(0.05 * kDegree)),
                     truth_.base_in_map + head * truth_.camera_in_head + any(0.002)});
    }
    return all;
  }

  std::mt19937 random_{7};
  HandEye truth_{.head_from_camera = so3_exp({0.05, -0.08, 0.1}) * nominal_head_from_camera(),
                 .camera_in_head = {0.05, -0.02, 0.03},
                 .map_from_base = so3_exp({1, -2, 0.5}),
                 .base_in_map = {1, 2, 1.5}};
};

TEST_F(HandEyeTest, IsFoundWithItsResiduals) {
  for (int i = 0; i < 10; ++i) {
    const auto found = calibrate_hand_eye(glances(40));
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_LT(found->head_from_camera.angularDistance(truth_.head_from_camera), 0.15 * kDegree);
    EXPECT_LT(found->map_from_base.angularDistance(truth_.map_from_base), 0.15 * kDegree);
    EXPECT_LT((found->camera_in_head - truth_.camera_in_head).norm(), 0.006);
    EXPECT_LT((found->base_in_map - truth_.base_in_map).norm(), 0.006);
    EXPECT_NEAR(found->rotation_residual, 0.15 * kDegree, 0.07 * kDegree);
    EXPECT_NEAR(found->position_residual, 0.002 * std::sqrt(3), 0.001);
    EXPECT_GE(found->used, 38U);
  }
}

TEST_F(HandEyeTest, SomeLostGlancesDoNotHarm) {
  auto all = glances(40);
  for (size_t i = 0; i < all.size(); i += 5)
    all[i].map_from_camera = so3_exp({1, 0.3 * i, 0.2}) * all[i].map_from_camera;
  const auto found = calibrate_hand_eye(all);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(found->head_from_camera.angularDistance(truth_.head_from_camera), 0.2 * kDegree);
  EXPECT_LE(found->used, 32U);
}

TEST_F(HandEyeTest, ACameraThatIsMountedOnItsSideIsFoundToo) {
  truth_.head_from_camera = nominal_head_from_camera() * so3_exp({0, 0, 90 * kDegree});
  const auto found = calibrate_hand_eye(glances(40));
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(found->head_from_camera.angularDistance(truth_.head_from_camera), 0.15 * kDegree);
}

std::string refusal(const std::vector<Glance>& glances) {
  const auto found = calibrate_hand_eye(glances);
  return found ? "found" : found.error().message;
}

TEST_F(HandEyeTest, WhatTellsTooLittleIsRefusedWithARemedy) {
  EXPECT_THAT(refusal(glances(7)), HasSubstr("7 glances of 8"));
  EXPECT_THAT(refusal({}), HasSubstr("0 glances"));
  EXPECT_THAT(refusal(glances(20, 0.05)), HasSubstr("hardly differ in pan"));
  auto level = glances(20);
  for (Glance& glance : level) glance.angles.tilt = 0;
  EXPECT_THAT(refusal(level), HasSubstr("hardly differ in tilt"));
  auto wild = glances(30);
  for (size_t i = 0; i < wild.size(); ++i) {
    if (i % 5 < 2) wild[i].map_from_camera = so3_exp({0.1 * i, 1, 2}) * wild[i].map_from_camera;
  }
  EXPECT_THAT(refusal(wild), HasSubstr("fit each other"));
}

}  // namespace
}  // namespace cairn
