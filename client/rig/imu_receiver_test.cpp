// SPDX-License-Identifier: Apache-2.0
#include "client/rig/imu_receiver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "client/inertial/inertial_sensor.h"
#include "common/geometry/se3.h"

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

/// At 400 samples a second a state has 25 ms of them. A head on a shoulder that sways by 10 degrees, twice a
/// second.
TEST(ImuReceiver, StatesThatComeLateAt400HzLoseSamplesAcrossWhichTheTurnIsKnownAllTheSame) {
  const auto angle = [](double t) { return 0.17 * std::sin(4 * M_PI * t); };
  const auto rate = [](double t) { return 0.17 * 4 * M_PI * std::cos(4 * M_PI * t); };
  constexpr auto kSample = 2500us;
  const auto sensor_after = [&](int apart) {  // samples from state to state
    ImuQueue queue;
    ImuReceiver receiver(queue);
    for (int last = 20; last <= 400; last += apart) {
      wire::RigState state = state_of(1, 0);
      for (int i = last - 9; i <= last; ++i) {
        const Timestamp time = Timestamp{} + i * kSample;
        const auto about_z = static_cast<float>(rate(seconds_between(time, {})));
        state.samples.push_back({time, Eigen::Vector3f(0, 0, about_z), Eigen::Vector3f(0, 0, 9.8F)});
      }
      (void)receiver.hear(state);
    }
    std::vector<ImuSample> samples;
    queue.take({}, &samples);
    InertialSensor sensor(queue.mount().value(), InertialSensorOptions());
    sensor.add(samples);
    return sensor;
  };
  const InertialSensor on_time = sensor_after(4);
  for (const int apart : {12, 20, 28}) {  // 30, 50, 70 ms
    const InertialSensor late = sensor_after(apart);
    for (double from = 0.1; from < 0.8; from += 0.033) {
      const Timestamp begin = Timestamp::from_seconds(from);
      const Timestamp end = Timestamp::from_seconds(from + 0.033);
      const auto turn = late.turn(begin, end);
      ASSERT_TRUE(turn) << apart << ", " << from;
      const double off = so3_log(turn->now_from_before).z() + angle(from + 0.033) - angle(from);
      EXPECT_LT(std::abs(off), 3 * turn->sigma) << apart << ", " << from;
      EXPECT_LT(std::abs(off), 0.3 * M_PI / 180) << apart << ", " << from;
      EXPECT_GE(turn->sigma, on_time.turn(begin, end)->sigma);
    }
  }
  EXPECT_FALSE(sensor_after(32).turn(Timestamp::from_seconds(0.1), Timestamp::from_seconds(0.2)))
      << "80 ms apart: nobody knows what the head did for 57";
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
