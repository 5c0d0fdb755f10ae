// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/inertial_sensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "client/inertial/imu_stream.h"
#include "common/geometry/se3.h"

namespace cairn {
namespace {

constexpr double kGravity = 9.80665;
constexpr double kDegree = M_PI / 180;

/// A head that sways about all axes: the world from it.
Eigen::Quaterniond swaying(double t) {
  return so3_exp({0.4 * std::sin(3 * t), 0.3 * std::sin(5 * t + 1), 0.5 * std::sin(2 * t)});
}

struct Measuring {
  std::function<Eigen::Quaterniond(double)> world_from_camera = swaying;
  ImuMount mount;
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();  ///< IMU axes
  std::function<Eigen::Vector3d(double)> moved = [](double) { return Eigen::Vector3d::Zero(); };  ///< world

  [[nodiscard]] ImuSample at(double t) const {
    constexpr double kStep = 1e-4;
    const auto imu = [&](double s) { return world_from_camera(s) * mount.camera_from_imu; };
    ImuSample sample;
    sample.time = Timestamp::from_seconds(t) + -mount.clock_offset;
    sample.rate = so3_log(imu(t - kStep).conjugate() * imu(t + kStep)) / (2 * kStep) + bias;
    sample.acceleration = imu(t).conjugate() * (moved(t) + Eigen::Vector3d(0, 0, kGravity));
    return sample;
  }
  [[nodiscard]] std::vector<ImuSample> from(double begin, double end, double frequency = 200) const {
    std::vector<ImuSample> samples;
    for (int i = 0; begin + i / frequency <= end; ++i) samples.push_back(at(begin + i / frequency));
    return samples;
  }
  [[nodiscard]] Eigen::Quaterniond turn(double from, double to) const {
    return world_from_camera(to).conjugate() * world_from_camera(from);
  }
};

Timestamp at(double seconds) {
  return Timestamp::from_seconds(seconds);
}

double angle(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return so3_log(a * b.conjugate()).norm();
}

ImuMount odd_mount() {
  return {so3_exp({1.2, -0.4, 2.0}), std::chrono::milliseconds(7)};
}

TEST(InertialSensor, TurnsAsTheCameraDoesHoweverItSitsAndWhateverItsClock) {
  Measuring measuring;
  measuring.mount = odd_mount();
  InertialSensor sensor(measuring.mount, InertialSensorOptions());
  sensor.add(measuring.from(0, 1));
  for (double t = 0.1; t < 0.9; t += 0.0331) {
    const auto turn = sensor.turn(at(t), at(t + 0.0333));
    ASSERT_TRUE(turn);
    EXPECT_LT(angle(turn->now_from_before, measuring.turn(t, t + 0.0333)), 1e-4);
  }
}

TEST(InertialSensor, TurnsOfPartsMakeTheTurnOfTheWhole) {
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());
  sensor.add(Measuring{}.from(0, 1));
  const auto whole = sensor.turn(at(0.2), at(0.5));
  const auto first = sensor.turn(at(0.2), at(0.313));
  const auto second = sensor.turn(at(0.313), at(0.5));
  EXPECT_LT(angle(second->now_from_before * first->now_from_before, whole->now_from_before), 1e-4);
  EXPECT_GT(whole->sigma, first->sigma);
}

TEST(InertialSensor, DoesNotAnswerWhereSamplesAreMissing) {
  const Measuring measuring;
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());
  EXPECT_FALSE(sensor.turn(at(0), at(0.1)));
  sensor.add(measuring.from(1, 2));
  EXPECT_FALSE(sensor.turn(at(0.99), at(1.1))) << "before the first";
  EXPECT_FALSE(sensor.turn(at(1.9), at(2.03))) << "after the last";
  const auto ahead = sensor.turn(at(1.9), at(2.01));
  ASSERT_TRUE(ahead) << "a little after it";
  EXPECT_GT(ahead->sigma, 1e-3);
  EXPECT_FALSE(sensor.turn(at(1.5), at(1.4))) << "backwards";
  sensor.add(measuring.from(2.1, 2.5));
  EXPECT_FALSE(sensor.turn(at(1.98), at(2.2))) << "across a gap";
  EXPECT_TRUE(sensor.turn(at(2.15), at(2.2)));
}

/// A head that is shaken: what happened in a gap of 40 ms nobody knows to a tenth of a degree.
TEST(InertialSensor, AGapInTheSamplesMakesATurnAcrossItLessSure) {
  Measuring measuring;
  measuring.world_from_camera = [](double t) {
    return so3_exp({0.04 * std::sin(28 * t), 0.03 * std::sin(31 * t + 1), 0.02 * std::sin(25 * t)});
  };
  const auto turn_without = [&](double begin, double end) {
    InertialSensor sensor(ImuMount{}, InertialSensorOptions());
    sensor.add(measuring.from(0, begin));
    sensor.add(measuring.from(end, 1));
    return sensor.turn(at(0.48), at(0.56)).value_or(CameraTurn());
  };
  double furthest = 0;
  for (const double phase : {0.0, 0.05, 0.1, 0.15, 0.2}) {
    const auto shaken = measuring.world_from_camera;
    measuring.world_from_camera = [&](double t) { return shaken(t + phase); };
    const CameraTurn whole = turn_without(0.52, 0.525);
    const CameraTurn across = turn_without(0.5, 0.54);
    EXPECT_LT(whole.sigma, 2e-3);
    EXPECT_GT(across.sigma, 2 * whole.sigma);
    const double off = angle(across.now_from_before, measuring.turn(0.48, 0.56));
    EXPECT_LT(off, 3 * across.sigma);
    furthest = std::max(furthest, off / whole.sigma);
    measuring.world_from_camera = shaken;
  }
  EXPECT_GT(furthest, 1) << "without the gap's part the sigma would not cover it";
}

TEST(InertialSensor, ToleratesSamplesTwiceAndLateAndBeginsAnewWhenTimeJumpsBack) {
  const Measuring measuring;
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());
  sensor.add(measuring.from(5, 6));
  sensor.add(measuring.from(5.9, 6.2));
  EXPECT_LT(angle(sensor.turn(at(5.95), at(6.1))->now_from_before, measuring.turn(5.95, 6.1)), 1e-4);
  sensor.add(measuring.from(1, 2));
  EXPECT_FALSE(sensor.turn(at(5.95), at(6.1)));
  EXPECT_LT(angle(sensor.turn(at(1.5), at(1.6))->now_from_before, measuring.turn(1.5, 1.6)), 1e-4);
}

TEST(InertialSensor, LearnsTheBiasFromTheImagesAndTurnsWithoutIt) {
  Measuring measuring;
  measuring.mount = odd_mount();
  measuring.bias = {0.02, -0.015, 0.01};
  InertialSensor sensor(measuring.mount, InertialSensorOptions());
  sensor.add(measuring.from(0, 0.5));
  const double doubt = sensor.turn(at(0.1), at(0.4))->sigma;
  for (int i = 0; i < 300; ++i) {
    const double t = 0.5 + i / 30.0;
    sensor.add(measuring.from(t, t + 1 / 30.0));
    sensor.tracked(at(t), at(t + 1 / 30.0), measuring.turn(t, t + 1 / 30.0));
  }
  EXPECT_LT((sensor.bias() - measuring.mount.camera_from_imu * measuring.bias).norm(), 1e-3);
  EXPECT_LT(angle(sensor.turn(at(9), at(10))->now_from_before, measuring.turn(9, 10)), 2e-3);
  EXPECT_LT(sensor.turn(at(9.1), at(9.4))->sigma, doubt / 4);
  EXPECT_FALSE(sensor.contradicts_images());
}

TEST(InertialSensor, AGyroThatSitsOtherwiseContradictsTheImages) {
  Measuring measuring;
  measuring.mount = odd_mount();
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());  // as if its axes were the camera's
  for (int i = 0; i < 60; ++i) {
    const double t = i / 30.0;
    sensor.add(measuring.from(t, t + 1 / 30.0));
    sensor.tracked(at(t + 0.01), at(t + 0.02), measuring.turn(t + 0.01, t + 0.02));
    sensor.tracked(at(t), at(t + 1 / 30.0 - 0.001), measuring.turn(t, t + 1 / 30.0 - 0.001));
  }
  EXPECT_TRUE(sensor.contradicts_images());
  EXPECT_LT(sensor.bias().norm(), 0.1) << "and nothing is learnt from it";
}

TEST(InertialSensor, AnotherClockCountsForTheSamplesOfBeforeAndOtherAxesBeginAnew) {
  Measuring measuring;
  measuring.mount = odd_mount();
  ImuMount guessed = measuring.mount;
  guessed.clock_offset -= std::chrono::milliseconds(30);
  InertialSensor sensor(guessed, InertialSensorOptions());
  sensor.add(measuring.from(0, 1));
  EXPECT_GT(angle(sensor.turn(at(0.5), at(0.6))->now_from_before, measuring.turn(0.5, 0.6)), 1e-3);
  sensor.use(measuring.mount);
  EXPECT_LT(angle(sensor.turn(at(0.5), at(0.6))->now_from_before, measuring.turn(0.5, 0.6)), 1e-4);
  sensor.use(ImuMount{Eigen::Quaterniond::Identity(), measuring.mount.clock_offset});
  EXPECT_FALSE(sensor.turn(at(0.5), at(0.6)));
  sensor.use(measuring.mount);
  sensor.add(measuring.from(1, 2));
  EXPECT_LT(angle(sensor.turn(at(1.5), at(1.6))->now_from_before, measuring.turn(1.5, 1.6)), 1e-4);
}

TEST(InertialSensor, KnowsWhereUpIsWhileItTurns) {
  Measuring measuring;
  measuring.mount = odd_mount();
  InertialSensor sensor(measuring.mount, InertialSensorOptions());
  EXPECT_FALSE(sensor.up(at(0)));
  sensor.add(measuring.from(0, 4));
  const auto up = sensor.up(at(3.9));
  ASSERT_TRUE(up);
  const Eigen::Vector3d truth = swaying(3.9).conjugate() * Eigen::Vector3d::UnitZ();
  EXPECT_LT(std::acos(up->up.dot(truth)), 1 * kDegree);
  EXPECT_FALSE(sensor.up(at(1000)));
}

TEST(InertialSensor, AShakenOneKnowsUpLaterAndIsNotDeceived) {
  Measuring measuring;
  measuring.moved = [](double t) {
    return Eigen::Vector3d(6 * std::sin(12 * t), 6 * std::cos(9 * t), 5 * std::sin(15 * t));
  };
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());
  sensor.add(measuring.from(0, 0.5));
  EXPECT_FALSE(sensor.up(at(0.5))) << "half a second of strong motion tells nothing";
  for (double t = 0.5; t < 40; t += 0.5) {
    sensor.add(measuring.from(t, t + 0.5));
    for (double frame = t; frame < t + 0.45; frame += 0.04)
      sensor.tracked(at(frame), at(frame + 0.04), measuring.turn(frame, frame + 0.04));
    const auto up = sensor.up(at(t + 0.4));
    EXPECT_TRUE(up || t < 30) << t << ": known once the gyro's bias is";
    if (!up) continue;
    const Eigen::Vector3d truth = swaying(t + 0.4).conjugate() * Eigen::Vector3d::UnitZ();
    EXPECT_LT(std::acos(std::min(1.0, up->up.dot(truth))), 3 * up->sigma) << t;
  }
}

TEST(InertialSensor, FallingItDoesNotKnowUp) {
  InertialSensor sensor(ImuMount{}, InertialSensorOptions());
  std::vector<ImuSample> samples = Measuring{}.from(0, 1);
  for (ImuSample& sample : samples) sample.acceleration.setZero();
  sensor.add(samples);
  EXPECT_FALSE(sensor.up(at(0.9)));
}

TEST(ImuRecording, GivesEachFrameWhatItNeedsOnce) {
  const Measuring measuring;
  ImuRecording recording(ImuMount{}, measuring.from(0, 1, 100));
  std::vector<ImuSample> samples;
  recording.take(at(0.095), &samples);
  EXPECT_EQ(samples.size(), 11U);
  EXPECT_EQ(samples.back().time, at(0.1));
  recording.take(at(5), &samples);
  EXPECT_EQ(samples.size(), 101U);
  recording.take(at(6), &samples);
  EXPECT_EQ(samples.size(), 101U);
}

TEST(ImuQueue, GivesWhatHasComeInOrderAndForgetsWhatNobodyTakes) {
  ImuQueue queue(ImuMount{});
  ImuSample sample;
  for (; sample.time.nanoseconds < 10'000; ++sample.time.nanoseconds) queue.put(sample);
  std::vector<ImuSample> samples;
  queue.take(at(0), &samples);
  ASSERT_GT(samples.size(), 1000U);
  EXPECT_LT(samples.size(), 5000U);
  for (size_t i = 0; i < samples.size(); ++i)
    EXPECT_EQ(samples[i].time.nanoseconds, 10'000 - static_cast<int64_t>(samples.size() - i));
  samples.clear();
  queue.take(at(0), &samples);
  EXPECT_TRUE(samples.empty());
}

}  // namespace
}  // namespace cairn
