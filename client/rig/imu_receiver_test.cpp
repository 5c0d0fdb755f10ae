// SPDX-License-Identifier: Apache-2.0
#include "client/rig/imu_receiver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

/// A rig whose state has the samples of those hundredths of a second.
wire::RigState state_of(int first, int last) {
  wire::RigState state;
  state.rig = "shoulder";
  state.camera_from_imu = Eigen::Quaterniond::Identity();
  state.calibrated_offset = 0;
  for (int i = first; i <= last; ++i) {
    const Eigen::Vector3f rate(static_cast<float>(i), 0, 0);
    state.samples.push_back({Timestamp{} + i * 10ms, rate, Eigen::Vector3f(0, 0, 9.8F)});
  }
  return state;
}

std::vector<int> taken(ImuQueue* queue) {
  std::vector<ImuSample> samples;
  queue->take({}, &samples);
  std::vector<int> hundredths;
  for (const ImuSample& sample : samples) {
    hundredths.push_back(static_cast<int>((sample.time - Timestamp{}) / 10ms));
    EXPECT_EQ(sample.rate, Eigen::Vector3d(hundredths.back(), 0, 0));
    EXPECT_NEAR(sample.acceleration.z(), 9.8, 1e-6);
  }
  return hundredths;
}

TEST(ImuReceiver, GivesEachSampleOnceThoughStatesRepeatThemAndAreLost) {
  ImuQueue queue;
  ImuReceiver receiver(queue);
  for (int last = 10; last <= 30; last += 2) {
    if (last == 14 || last == 20 || last == 22) continue;  // lost
    (void)receiver.hear(state_of(last - 7, last));
  }
  std::vector<int> all;
  for (int i = 3; i <= 30; ++i) all.push_back(i);
  EXPECT_EQ(taken(&queue), all);
}

TEST(ImuReceiver, AClockThatIsSetBackBeginsAnew) {
  ImuQueue queue;
  ImuReceiver receiver(queue);
  (void)receiver.hear(state_of(1000, 1003));
  (void)receiver.hear(state_of(998, 1001));
  EXPECT_EQ(taken(&queue), (std::vector<int>{1000, 1001, 1002, 1003})) << "a state that comes late is none";
  (void)receiver.hear(state_of(5, 6));
  (void)receiver.hear(state_of(6, 7));
  EXPECT_EQ(taken(&queue), (std::vector<int>{5, 6, 7}));
}

TEST(ImuReceiver, WhatTheRigDoesNotKnowIsSaidOnceWithTheRemedyAndTakenOverWhenItDoes) {
  ImuQueue queue;
  ImuReceiver receiver(queue);
  wire::RigState state = state_of(1, 4);
  state.camera_from_imu.reset();
  auto news = receiver.hear(state);
  ASSERT_TRUE(news);
  EXPECT_TRUE(news->is_warning);
  EXPECT_THAT(news->text, HasSubstr("cairn-rig calibrate"));
  EXPECT_FALSE(receiver.hear(state));
  EXPECT_FALSE(queue.mount());

  const Eigen::Quaterniond sits(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitY()));
  state.camera_from_imu = sits;
  state.calibrated_offset.reset();
  news = receiver.hear(state);
  ASSERT_TRUE(news && news->is_warning);
  EXPECT_THAT(news->text, HasSubstr("stamps of the camera"));
  EXPECT_FALSE(queue.mount());

  state.calibrated_offset = 7'000'000;
  news = receiver.hear(state);
  ASSERT_TRUE(news && !news->is_warning);
  EXPECT_THAT(news->text, HasSubstr("7.0 ms"));
  EXPECT_EQ(queue.mount(), (ImuMount{sits, -7ms}));

  state.camera_clock = {true, 9'000'000, 0.001F};
  EXPECT_FALSE(receiver.hear(state)) << "that it is known better now is the rig's to say";
  EXPECT_EQ(queue.mount(), (ImuMount{sits, -9ms}));
}

TEST(ImuReceiver, EncodersCountWhileTheImuIsSilentOnly) {
  ImuQueue queue;
  ImuReceiver receiver(queue);
  const auto encoders = [&queue] {
    std::vector<EncoderSample> samples;
    queue.take_encoders(&samples);
    return samples;
  };
  wire::RigState state = state_of(100, 104);
  state.time = Timestamp{} + 1045ms;
  (void)receiver.hear(state);
  EXPECT_TRUE(encoders().empty()) << "nobody knows them";
  state.base_from_camera = Eigen::Quaterniond(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ()));
  (void)receiver.hear(state);
  EXPECT_TRUE(encoders().empty()) << "the gyro knows better";
  state.time = Timestamp{} + 1300ms;
  state.calibrated_offset = 5'000'000;
  (void)receiver.hear(state);
  const auto heard = encoders();
  ASSERT_EQ(heard.size(), 1U);
  EXPECT_EQ(heard[0].time, Timestamp{} + 1295ms) << "by the camera's clock";
  EXPECT_TRUE(heard[0].base_from_camera.isApprox(*state.base_from_camera));
  state.samples.clear();
  (void)receiver.hear(state);
  EXPECT_EQ(encoders().size(), 1U) << "a rig without an IMU";
}

TEST(ImuReceiver, OfARigThatSendsNoSamplesNothingIsSaid) {
  ImuQueue queue;
  ImuReceiver receiver(queue);
  wire::RigState of_before;  // of a rig without these members
  of_before.rig = "shoulder";
  of_before.has_imu = true;
  EXPECT_FALSE(receiver.hear(of_before));
  EXPECT_FALSE(queue.mount());
}

}  // namespace
}  // namespace cairn
