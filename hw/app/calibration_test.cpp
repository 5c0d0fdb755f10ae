// SPDX-License-Identifier: Apache-2.0
// cairn-rig calibrate without its threads: a tour on a bridge and simulated devices whose truth is known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <numbers>
#include <random>
#include <stdexcept>

#include "common/geometry/se3.h"
#include "hw/app/bridge_bench.h"
#include "hw/app/calibration_drive.h"
#include "hw/app/offset_watch.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::BridgeBench;
using ::testing::Contains;
using ::testing::HasSubstr;
using testing::order_of;

constexpr double kDegree = std::numbers::pi / 180;

RigCalibration truth() {
  RigCalibration truth;
  truth.head_from_camera = so3_exp(Eigen::Vector3d(2, -3, 4) * kDegree) * nominal_head_from_camera();
  truth.head_from_imu = so3_exp(Eigen::Vector3d(-5, 4, 88) * kDegree);
  truth.offset = 23ms;
  return truth;
}

/// The tracker of the rig's camera: 30 images a second, each with a pose 40 ms after it was taken.
class Tracker {
 public:
  bool speaks = true;
  bool is_tracked = true;
  bool stands_still = false;  ///< it has another camera
  std::string map = "desk";
  Eigen::Quaterniond map_from_base = so3_exp({0.3, -0.2, 1.1});
  std::function<bool(const PanTilt&)> sees = [](const PanTilt&) { return true; };

  /// A millisecond: the pose that comes, if any. `now` is the true time, which is the IMU's.
  std::optional<TourPose> turn(const PanTilt& head, MonotonicTime now) {
    if (++milliseconds_ % 33 == 0) {
      const Eigen::Quaterniond map_from_head =
          map_from_base * base_from_head(stands_still ? PanTilt() : head);
      const Eigen::Vector3d noise{noise_(random_), noise_(random_), noise_(random_)};
      on_their_way_.push_back(
          {now + 40ms,
           {Timestamp{(now - truth().offset).time_since_epoch().count()}, is_tracked && sees(head), map,
            map_from_head * truth().head_from_camera * so3_exp(noise),
            Eigen::Vector3d(1, 2, 3) + map_from_head * Eigen::Vector3d(0.05, 0.02, 0.03)}});
    }
    if (on_their_way_.empty() || on_their_way_.front().first > now) return std::nullopt;
    const TourPose pose = on_their_way_.front().second;
    on_their_way_.pop_front();
    return speaks ? std::optional(pose) : std::nullopt;
  }

 private:
  int milliseconds_ = 0;
  std::mt19937 random_{3};
  std::normal_distribution<double> noise_{0, 0.05 * kDegree};
  std::deque<std::pair<MonotonicTime, TourPose>> on_their_way_;
};

class CalibrationOfARig : public ::testing::Test {
 protected:
  [[nodiscard]] Timestamp now() const { return {bench_.now().time_since_epoch().count()}; }

  /// The tour to its end, as CalibrationDrive runs it.
  Result<TourFindings> run() {
    auto tour = CalibrationTour::plan(testing::read_rig(testing::kRigText).value(), now()).value();
    TourCommander commander("shoulder", {77});
    const MonotonicTime end = bench_.now() + 5min;
    while (!tour.is_over() && bench_.now() < end) {
      bench_.millisecond();
      each_millisecond();
      if (const auto pose = tracker_.turn(bench_.devices().head(), bench_.now())) tour.see(*pose);
      if (++milliseconds_ % 10 != 0) continue;
      for (const GyroSample& sample : bench_.bridge().take_gyro()) tour.sense(sample);
      tour.take(report_of(bench_.state(), commander.newest(), now()));
      const auto order = tour.advance(now());
      for (std::string& words : tour.take_words()) words_.push_back(std::move(words));
      if (!order) return tl::unexpected(order.error());
      if (tour.is_ready()) {
        EXPECT_TRUE(bench_.state().drives_idle) << "before the question";
        tour.begin(now());
      } else if (const auto command = commander.say(*order)) {
        bench_.say(*command);
      }
    }
    if (!tour.is_over()) return fail(ErrorCode::kInternal, "it does not end");
    EXPECT_TRUE(bench_.state().drives_idle);
    return tour.conclude();
  }
  /// Three seconds after the tour has said so.
  void change_map_after(const std::string& words) {
    each_millisecond = [this, words, said = false, left = 3000]() mutable {
      said = said || (!words_.empty() && words_.back().find(words) != std::string::npos);
      if (!said || left-- != 0) return;
      tracker_.map = "bench";
      tracker_.map_from_base = so3_exp({0.1, 0.4, -2});
    };
  }
  std::string refusal() {
    const auto found = run();
    if (found) return "found";
    EXPECT_EQ(found.error().code, ErrorCode::kRefused);
    return found.error().message;
  }

  BridgeBench bench_{{}, truth()};
  Tracker tracker_;
  std::function<void()> each_millisecond = [] {};
  std::vector<std::string> words_;

 private:
  int milliseconds_ = 0;
};

TEST_F(CalibrationOfARig, FindsWhatTheDevicesAre) {
  const auto found = run();
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_LT(found->calibration.head_from_camera.angularDistance(truth().head_from_camera), 0.2 * kDegree);
  EXPECT_LT(found->calibration.head_from_imu.angularDistance(truth().head_from_imu), 0.7 * kDegree);
  EXPECT_NEAR(std::chrono::duration<double>(found->calibration.offset).count(), 0.023, 0.003);
  ASSERT_TRUE(found->gyro);
  EXPECT_LT(found->gyro->sigma, 0.003);
  EXPECT_NEAR(std::chrono::duration<double>(found->calibration.offset).count(), 0.023,
              4 * found->gyro->sigma + 0.001);  // samples and frames take some of a millisecond
  EXPECT_EQ(found->glances, 15U);
  EXPECT_LT(found->hand_eye.rotation_residual, 0.3 * kDegree);
  EXPECT_LT((found->hand_eye.camera_in_head - Eigen::Vector3d(0.05, 0.02, 0.03)).norm(), 0.01);
  EXPECT_THAT(words_, Contains(HasSubstr("place 15 of 15")));
  bench_.devices().tell_extremes();
  EXPECT_THAT(bench_.told, Contains(HasSubstr("never at its hard stop")));
}

TEST_F(CalibrationOfARig, PlacesWhereTheTrackerIsLostAreLeftOut) {
  tracker_.sees = [](const PanTilt& head) { return head.pan < 15 * kDegree; };
  const auto found = run();
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_EQ(found->glances, 12U);
  EXPECT_LT(found->calibration.head_from_camera.angularDistance(truth().head_from_camera), 0.2 * kDegree);
  EXPECT_THAT(words_, Contains(HasSubstr("it is left out")));
}

TEST_F(CalibrationOfARig, WithoutATrackerNothingMoves) {
  tracker_.speaks = false;
  EXPECT_THAT(refusal(), HasSubstr("no tracker speaks to rig shoulder; start `cairn-track --rig shoulder`"));
  tracker_.speaks = true;
  tracker_.is_tracked = false;
  EXPECT_THAT(refusal(), HasSubstr("has no map where it looks"));
  EXPECT_EQ(bench_.told, std::vector<std::string>());
}

TEST_F(CalibrationOfARig, WhatGoesWrongOnTheWayEndsItWithTheReason) {
  each_millisecond = [this] { tracker_.speaks = bench_.state().mode != wire::RigMode::kJog; };
  EXPECT_THAT(refusal(), HasSubstr("the tracker of the rig's camera fell silent"));
}

TEST_F(CalibrationOfARig, AStuckAxisIsNamed) {
  each_millisecond = [this, stuck = false]() mutable {
    if (stuck || bench_.state().mode != wire::RigMode::kJog) return;
    stuck = true;
    bench_.devices().inject(DeviceFault::kStuckPan, std::nullopt, bench_.now());
  };
  EXPECT_THAT(refusal(), HasSubstr("pan (node 16) does not follow"));
}

TEST_F(CalibrationOfARig, ASilentDriveAndAnEmergencyStopAreNamed) {
  bench_.devices().inject(DeviceFault::kMuteTilt, 10s, bench_.now());
  EXPECT_THAT(refusal(), HasSubstr("tilt (node 17) does not answer"));
  bench_.pass(10s);
  bench_.say(order_of(4, 1, wire::RigMode::kClear));
  bench_.pass(1s);
  each_millisecond = [this] {
    if (bench_.state().mode == wire::RigMode::kJog) bench_.bridge().stop(bench_.now());
  };
  EXPECT_THAT(refusal(), HasSubstr("emergency stop"));
}

TEST_F(CalibrationOfARig, AnImuAtAnotherRateIsNamed) {
  bench_.devices().inject(DeviceFault::kImuRate, std::nullopt, bench_.now());
  bench_.pass(2s);
  EXPECT_THAT(refusal(), HasSubstr("the IMU samples at another rate"));
}

TEST_F(CalibrationOfARig, ACameraThatIsNotOnTheHeadIsRefused) {
  tracker_.stands_still = true;
  EXPECT_THAT(refusal(), HasSubstr("camera on the head"));
}

TEST_F(CalibrationOfARig, AnotherMapBeginsAnew) {
  change_map_after("place 4 of 15");
  const auto found = run();
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_THAT(words_, Contains(HasSubstr("in another map; 5 places")));
  EXPECT_EQ(found->glances, 10U);
  EXPECT_LT(found->hand_eye.rotation_residual, 0.3 * kDegree);
  EXPECT_LT(found->calibration.head_from_camera.angularDistance(truth().head_from_camera), 0.2 * kDegree);
}

TEST_F(CalibrationOfARig, AnotherMapAfterAllPlacesLeavesNoneToCalibrateBy) {
  change_map_after("shaking gently");
  EXPECT_THAT(refusal(), HasSubstr("camera on the head"));
  EXPECT_THAT(words_, Contains(HasSubstr("in another map; 15 places")));
}

/// A head that a hand turns, and who watches it.
class OffsetWatches : public ::testing::Test {
 protected:
  static Eigen::Quaterniond stands(double t) {
    return so3_exp({0.2 * std::sin(5 * t), 0.15 * std::sin(7 * t), 0.1 * std::sin(4 * t)});
  }
  /// Ten seconds from `begin` on of a camera whose stamps lack 50 ms, and of a gyro; at another pace than 1
  /// they do not turn alike.
  void turn(double begin, SessionId tracker, double pace = 1) {
    std::vector<GyroSample> gyro;
    for (int i = 1; i < 1000; ++i) {
      const double t = begin + i * 0.01;
      const Eigen::Quaterniond turn = stands(pace * (t - 0.01)).conjugate() * stands(pace * t);
      gyro.push_back({Timestamp::from_seconds(t), so3_log(turn) / 0.01});
    }
    watch_.sense(gyro);
    for (double t = begin + 1; t < begin + 9; t += 1.0 / 30)
      watch_.see({Timestamp::from_seconds(t - 0.05), stands(t)}, tracker);
  }
  [[nodiscard]] bool comes_to(bool known) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, 60s, [&] { return last_ && last_->known == known; });
  }
  [[nodiscard]] double offset() {
    const std::lock_guard lock(mutex_);
    return static_cast<double>(last_.value_or(wire::RigCameraClock()).offset) * 1e-9;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<wire::RigCameraClock> last_;

 protected:
  std::atomic<int> failures_{0};  ///< of those who are told, that are still to come
  OffsetWatch watch_{null_logger(),
                     [this](const wire::RigCameraClock& clock) {
                       const std::lock_guard lock(mutex_);
                       if (failures_ > 0 && failures_-- > 0) throw std::runtime_error("nobody is told");
                       last_ = clock;
                       changed_.notify_all();
                     },
                     1ms};
};

TEST_F(OffsetWatches, TellWhatIsSharpAndKeepItWhereNothingTurns) {
  turn(0, {1});
  ASSERT_TRUE(comes_to(true));
  EXPECT_NEAR(offset(), 0.05, 0.002);
  CameraAndGyro vague;
  vague.sigma = 0.02;
  EXPECT_FALSE(camera_clock_of(vague));
  vague.sigma = std::nan("");
  EXPECT_FALSE(camera_clock_of(vague));
}

TEST_F(OffsetWatches, WithdrawWhatIsOfTheCameraOfAnotherTracker) {
  turn(0, {1});
  ASSERT_TRUE(comes_to(true));
  watch_.see({Timestamp::from_seconds(20), stands(20)}, {2});
  ASSERT_TRUE(comes_to(false));
  turn(30, {2});
  ASSERT_TRUE(comes_to(true));
  EXPECT_NEAR(offset(), 0.05, 0.002);
}

TEST_F(OffsetWatches, TellAgainWhatCouldNotBeTold) {
  failures_ = 1;
  turn(0, {1});
  ASSERT_TRUE(comes_to(true));
  failures_ = 2;
  watch_.see({Timestamp::from_seconds(20), stands(20)}, {2});
  EXPECT_TRUE(comes_to(false));
  EXPECT_EQ(failures_, 0);
}

/// Before, what had been told held for good.
TEST_F(OffsetWatches, WithdrawWhatGyroAndCameraContradict) {
  turn(0, {1});
  ASSERT_TRUE(comes_to(true));
  turn(30, {1}, 1.3);
  EXPECT_TRUE(comes_to(false));
}

TEST(CalibrationTour, IsNotPlannedWhereTheLimitsLeaveTooLittle) {
  std::string text = testing::kRigText;
  text.replace(text.find("[-40, 40]"), 9, "[-11, 40]");
  text.replace(text.find("home: 36"), 8, "home: -4");
  ASSERT_TRUE(CalibrationTour::plan(testing::read_rig(text).value(), {}));
  text.replace(text.find("[-11, 40]"), 9, "[-11, 11]");
  const auto plan = CalibrationTour::plan(testing::read_rig(text).value(), {});
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(plan.error().message, HasSubstr("axes.tilt: 10 degrees"));
}

}  // namespace
}  // namespace cairn
