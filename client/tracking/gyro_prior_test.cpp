// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/gyro_prior.h"

#include <gtest/gtest.h>

#include <array>

namespace cairn {
namespace {

constexpr int64_t kFrameTime = 33'333'333;  // [ns]
constexpr int64_t kSamplesPerFrame = 8;     // 240 Hz; what turns between samples is not known
constexpr double kReach = 30.0 / 525;       // [rad]

/// Frames of a camera at rest, whose gyro has a bias; how many it is carried blindly.
int frames_carried(int frames_before, double bias) {
  GyroPrior gyro{GyroPriorOptions()};
  gyro.use(ImuMount{});
  for (int i = 0; i < 2000; ++i) {
    for (int64_t k = 1; k <= kSamplesPerFrame; ++k) {
      const int64_t time = (i - 1) * kFrameTime + k * kFrameTime / kSamplesPerFrame;
      gyro.add(std::array<ImuSample, 1>{{{{time}, {0, bias, 0}, {0, -9.8, 0}}}});
    }
    gyro.next_frame({i * kFrameTime});
    if (i < frames_before) {
      gyro.tracked(SE3());
      gyro.seen();
    } else if (!gyro.carries(kReach)) {
      return i - frames_before;
    }
  }
  return 2000;
}

TEST(GyroPrior, CarriesForABoundedTimeThatIsLongerWhereItsBiasIsKnown) {
  const int unknown = frames_carried(2, 0.01);
  const int known = frames_carried(300, 0.01);
  EXPECT_GT(unknown, 10);
  EXPECT_LT(unknown, 45) << "a second and a half";
  EXPECT_GT(known, 3 * unknown);
  EXPECT_LT(known, 2000);
}

TEST(GyroPrior, SaysWhatItIsUsedFor) {
  GyroPrior gyro{GyroPriorOptions()};
  gyro.next_frame({0});
  gyro.next_frame({kFrameTime});
  EXPECT_EQ(gyro.use(), ImuUse::kNone);
  EXPECT_FALSE(gyro.turn() || gyro.carries(kReach));
  gyro.use(ImuMount{});
  gyro.next_frame({2 * kFrameTime});
  EXPECT_EQ(gyro.use(), ImuUse::kMissing);
  const std::array<ImuSample, 2> samples = {
      {{{2 * kFrameTime}, {0, 1, 0}, {0, -9.8, 0}}, {{3 * kFrameTime}, {0, 1, 0}, {0, -9.8, 0}}}};
  gyro.add(samples);
  gyro.next_frame({3 * kFrameTime});
  EXPECT_EQ(gyro.use(), ImuUse::kUsed);
  ASSERT_TRUE(gyro.turn());
  EXPECT_NEAR(so3_log(gyro.turn()->rotation()).y(), -kFrameTime * 1e-9, 1e-9);
}

TEST(GyroPrior, EncodersTellWhatNoGyroDoesAndCarryNothing) {
  GyroPrior gyro{GyroPriorOptions()};
  const auto panned = [](double angle) { return Eigen::Quaterniond(so3_exp({0, 0, angle})); };
  const std::array<EncoderSample, 2> samples = {{{{0}, panned(0.1)}, {{kFrameTime}, panned(0.3)}}};
  gyro.add(samples);
  gyro.next_frame({0});
  gyro.next_frame({kFrameTime});
  ASSERT_TRUE(gyro.turn());
  EXPECT_NEAR(so3_log(gyro.turn()->rotation()).z(), -0.2, 1e-9);
  EXPECT_EQ(gyro.use(), ImuUse::kNone);
  EXPECT_FALSE(gyro.carries(kReach)) << "what carries the rig may have turned";
  GyroPrior both{GyroPriorOptions()};
  both.use(ImuMount{});
  const std::array<ImuSample, 2> still = {
      {{{0}, {0, 0, 0}, {0, -9.8, 0}}, {{kFrameTime}, {0, 0, 0}, {0, -9.8, 0}}}};
  both.add(still);
  both.add(samples);
  both.next_frame({0});
  both.next_frame({kFrameTime});
  ASSERT_TRUE(both.turn());
  EXPECT_EQ(so3_log(both.turn()->rotation()).norm(), 0) << "the gyro has it";
}

TEST(GyroPrior, ATurnThatIsCountedIsNone) {
  GyroPrior gyro{GyroPriorOptions()};
  gyro.counted();
  EXPECT_FALSE(gyro.turn()) << "none is made up";
  gyro.use(ImuMount{});
  const std::array<ImuSample, 2> samples = {
      {{{0}, {0, 1, 0}, {0, -9.8, 0}}, {{kFrameTime}, {0, 1, 0}, {0, -9.8, 0}}}};
  gyro.add(samples);
  gyro.next_frame({0});
  gyro.next_frame({kFrameTime});
  gyro.counted();
  ASSERT_TRUE(gyro.turn());
  EXPECT_EQ(so3_log(gyro.turn()->rotation()).norm(), 0);
  gyro.use(std::nullopt);
  gyro.next_frame({2 * kFrameTime});
  EXPECT_EQ(gyro.use(), ImuUse::kNone);
  EXPECT_FALSE(gyro.turn());
}

}  // namespace
}  // namespace cairn
