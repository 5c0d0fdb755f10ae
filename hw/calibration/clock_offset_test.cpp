// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/clock_offset.h"

#include <gmock/gmock.h>

#include <cmath>
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

/// A mount with gyro and camera that a hand turns.
struct Mount {
  double offset = 0.037;  ///< the camera's stamps are early by that [s]
  Quaterniond camera_from_imu = so3_exp({0.5, -1.2, 0.7});
  Vector3d bias{0.01, -0.02, 0.005};
  double strength = 1;
  bool one_axis = false;
  double jumps = 0;  ///< share of poses that are wrong
  uint32_t seed = 1;

  /// Of the IMU.
  [[nodiscard]] Quaterniond stands(double t) const {
    const Vector3d turn(0.2 * std::sin(3 * t) + 0.05 * std::sin(11 * t), 0.15 * std::sin(4.3 * t + 1),
                        0.1 * std::sin(6 * t + 2));
    return so3_exp(strength * (one_axis ? Vector3d(turn.x(), 0, 0) : turn));
  }
  [[nodiscard]] std::vector<GyroSample> gyro() const {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, 0.003);
    std::vector<GyroSample> samples;
    for (int i = 1; i < 1500; ++i) {
      const double t = i * 0.01;
      const Vector3d rate = so3_log(stands(t - 0.01).conjugate() * stands(t)) / 0.01;
      samples.push_back({Timestamp::from_seconds(1000 + t),
                         rate + bias + Vector3d{noise(random), noise(random), noise(random)}});
    }
    return samples;
  }
  [[nodiscard]] std::vector<CameraRotation> camera() const {
    std::mt19937 random(seed + 1);
    std::normal_distribution<double> noise(0, 0.05 * kDegree);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<CameraRotation> rotations;
    for (double t = 0.5; t < 14; t += 1.0 / 30) {
      const double size = unit(random) < jumps ? 300 : 1;
      const Vector3d wrong = size * Vector3d{noise(random), noise(random), noise(random)};
      rotations.push_back(
          {Timestamp::from_seconds(1000 + t - offset),
           so3_exp({0.3, 0.2, 0.1}) * stands(t) * camera_from_imu.conjugate() * so3_exp(wrong)});
    }
    return rotations;
  }
};

TEST(ClockOffset, IsFoundWithRotationAndBias) {
  for (const double offset : {-0.25, -0.004, 0.0, 0.037, 0.2}) {
    for (const double jumps : {0.0, 0.05}) {
      Mount mount;
      mount.offset = offset;
      mount.jumps = jumps;
      const auto found = align_camera_and_gyro(mount.gyro(), mount.camera());
      ASSERT_TRUE(found) << found.error().message;
      EXPECT_NEAR(found->offset, offset, 0.002);
      EXPECT_NEAR(found->offset, offset, 5 * found->sigma + 2e-4);
      EXPECT_LT(found->sigma, 0.002);
      EXPECT_LT(found->camera_from_imu.angularDistance(mount.camera_from_imu), 0.5 * kDegree);
      EXPECT_LT((found->bias - mount.bias).norm(), 0.01);
      EXPECT_TRUE(found->rotation_known);
      EXPECT_GT(found->correlation, 0.9);
    }
  }
}

TEST(ClockOffset, IsFoundFromTurningAboutOneAxisToo) {
  Mount mount;
  mount.one_axis = true;
  const auto found = align_camera_and_gyro(mount.gyro(), mount.camera());
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_NEAR(found->offset, mount.offset, 0.002);
  EXPECT_FALSE(found->rotation_known);
}

std::string refusal(const std::vector<GyroSample>& gyro, const std::vector<CameraRotation>& camera) {
  const auto found = align_camera_and_gyro(gyro, camera);
  return found ? "found" : found.error().message;
}

TEST(ClockOffset, AGapInTheSamplesHasNoPartInIt) {
  const Mount mount;
  for (const double length : {0.15, 0.3, 0.5}) {
    std::vector<GyroSample> gyro = mount.gyro();
    std::erase_if(gyro, [&](const GyroSample& sample) {
      const double t = seconds_between(sample.when, Timestamp::from_seconds(1000));
      return t > 6 && t < 6 + length;
    });
    const auto found = align_camera_and_gyro(gyro, mount.camera());
    ASSERT_TRUE(found) << length;
    EXPECT_NEAR(found->offset, mount.offset, 0.002) << length;
  }
}

TEST(ClockOffset, WhatTellsNothingIsRefusedWithARemedy) {
  Mount still;
  still.strength = 0.01;
  EXPECT_THAT(align_camera_and_gyro(still.gyro(), still.camera()).error().message,
              HasSubstr("hardly turned"));
  Mount other;
  other.seed = 5;
  auto strange = other.gyro();
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1);
  for (GyroSample& sample : strange) sample.rate = {noise(random), noise(random), noise(random)};
  EXPECT_THAT(refusal(strange, other.camera()), HasSubstr("do not turn alike"));
  EXPECT_THAT(refusal({}, other.camera()), HasSubstr("0 images"));
  EXPECT_THAT(refusal(other.gyro(), {}), HasSubstr("0 images"));
  Mount apart;
  apart.offset = 0.8;
  EXPECT_FALSE(align_camera_and_gyro(apart.gyro(), apart.camera()));
}

TEST(ClockOffset, OfARigAtWorkKeepsToTheNewest) {
  const Mount mount;
  ClockOffset offset;
  EXPECT_FALSE(offset.estimate());
  Mount before;
  before.offset = -0.1;
  for (const Mount& each : {before, mount}) {  // the clocks were set meanwhile: all begins anew
    for (const GyroSample& sample : each.gyro()) offset.sense(sample);
    for (const CameraRotation& rotation : each.camera()) offset.see(rotation);
  }
  const auto found = offset.estimate();
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_NEAR(found->offset, mount.offset, 0.002);
}

}  // namespace
}  // namespace cairn
