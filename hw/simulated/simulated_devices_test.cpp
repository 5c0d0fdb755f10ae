// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>

#include "hw/simulated/simulated_bus.h"

namespace cairn::simulated {
namespace {

using namespace std::chrono_literals;
using odrive::AxisState;

/// One drive and an IMU, and a host that remembers the newest message of each kind.
class Devices : public ::testing::Test {
 protected:
  explicit Devices(const DriveOptions& options = {}) : bus_({options}, {}, 7, now_) {}

  void send(const odrive::Message& message) {
    ASSERT_EQ(bus_.send(odrive::encode({16}, message).value()), SendOutcome::kQueued);
  }
  /// Time passes, a millisecond at once, with `each` before each of them.
  void pass(
      std::chrono::milliseconds time, const std::function<void()>& each = [] {}) {
    for (const auto end = now_ + time; now_ < end;) {
      each();
      now_ += 1ms;
      bus_.advance(now_);
      while (const auto got = bus_.receive()) take(got->frame);
    }
  }
  void pass_with_setpoint(std::chrono::milliseconds time, float position) {
    pass(time, [&] { send(odrive::SetInputPosition{position, 0, 0}); });
  }
  void close_loop() {
    send(odrive::SetControllerMode{});
    send(odrive::SetAxisState{AxisState::kClosedLoop});
  }

  MonotonicTime now_{1h};
  SimulatedBus bus_;
  odrive::Heartbeat heartbeat_;
  odrive::EncoderEstimates estimates_;
  std::map<uint32_t, int> count_;  // of frames, by identifier
  double low_ = 0;
  double high_ = 0;

 private:
  void take(const CanFrame& frame) {
    ++count_[frame.id.value];
    const auto from = odrive::decode(frame, std::array{odrive::Node{16}});
    if (!from) return;
    if (const auto* heartbeat = std::get_if<odrive::Heartbeat>(&from->message)) heartbeat_ = *heartbeat;
    if (const auto* estimates = std::get_if<odrive::EncoderEstimates>(&from->message)) {
      estimates_ = *estimates;
      low_ = std::min(low_, double{estimates_.velocity});
      high_ = std::max(high_, double{estimates_.velocity});
    }
  }
};

TEST_F(Devices, SendWhatIsDueAndAnswerRequests) {
  pass(1s);
  EXPECT_NEAR(count_[0x201], 10, 1);
  EXPECT_NEAR(count_[0x209], 100, 1);
  for (const uint32_t id : {0x005U, 0x006U, 0x032U, 0x034U}) EXPECT_NEAR(count_[id], 100, 1) << id;
  send(odrive::Request::kErrors);
  pass(3ms);
  EXPECT_EQ(count_[0x203], 1);
}

TEST_F(Devices, TheSameSeedAndCallsGiveTheSameFrames) {
  const auto run = [](uint32_t seed) {
    MonotonicTime now{1h};
    SimulatedBus bus({DriveOptions()}, {}, seed, now);
    bus.drop(0.1);
    std::vector<CanFrame> frames;
    for (int i = 0; i < 300; ++i) {
      EXPECT_EQ(bus.send(odrive::encode({16}, odrive::SetInputPosition{0.5F, 0, 0}).value()),
                SendOutcome::kQueued);
      bus.advance(now += 1ms);
      while (const auto got = bus.receive()) frames.push_back(got->frame);
    }
    return frames;
  };
  EXPECT_EQ(run(3), run(3));
  EXPECT_NE(run(3), run(4));
}

TEST_F(Devices, ClosedLoopReachesItsSetpointWithinRateAndAcceleration) {
  send(odrive::SetLimits{4, 5});
  close_loop();
  pass_with_setpoint(100ms, 0);
  EXPECT_EQ(heartbeat_.state, AxisState::kClosedLoop);
  pass_with_setpoint(2s, 2);
  EXPECT_NEAR(estimates_.position, 2, 0.02);
  EXPECT_NEAR(estimates_.velocity, 0, 0.01);
  EXPECT_LT(high_, 4.2);  // SetLimits, whatever the distance
  EXPECT_GT(high_, 3.5);
}

TEST_F(Devices, WhatFrictionTakesIsGivenBackByTheDrivesIntegral) {
  close_loop();
  pass_with_setpoint(100ms, 0);
  // At an even rate, without it, friction makes it lag by 20 turns/s^2 / (7.5 * 20 / s) / (20 / s) = 0.007
  // turns.
  float position = 0;
  pass(2s, [&] { send(odrive::SetInputPosition{position += 0.001F, 1, 0}); });
  EXPECT_NEAR(bus_.drive(0).plant().shaft(), position, 0.003);
}

TEST_F(Devices, TheAxisFollowsTheMotorBehindItsBacklash) {
  const PlantOptions options;
  close_loop();
  pass_with_setpoint(1s, 1);
  const double forth = bus_.drive(0).plant().angle() - estimates_.position / options.turns_per_radian;
  pass_with_setpoint(1s, 0.5);
  const double back = bus_.drive(0).plant().angle() - estimates_.position / options.turns_per_radian;
  EXPECT_NEAR(back - forth, options.backlash, 1e-4);
}

TEST_F(Devices, HomingPutsZeroAtTheSwitch) {
  for (const float start : {0.0F, -3.3F}) {  // before the switch, and beyond it
    close_loop();
    pass_with_setpoint(2s, start);
    send(odrive::SetAxisState{AxisState::kHoming});
    pass(200ms);
    EXPECT_EQ(heartbeat_.procedure_result, 1);
    pass(6s);
    EXPECT_EQ(heartbeat_.state, AxisState::kIdle);
    EXPECT_EQ(heartbeat_.procedure_result, 0);
    EXPECT_NEAR(bus_.drive(0).plant().angle(), -1.0, 0.02);
    EXPECT_NEAR(estimates_.position, 0, 0.1);
  }
}

TEST_F(Devices, WithoutSetpointsTheWatchdogEndsClosedLoop) {
  close_loop();
  pass_with_setpoint(100ms, 1);
  pass(40ms);
  EXPECT_EQ(bus_.drive(0).state(), AxisState::kClosedLoop);
  pass(20ms);
  EXPECT_EQ(bus_.drive(0).state(), AxisState::kIdle);
  pass(100ms);
  EXPECT_EQ(heartbeat_.axis_error, odrive::kErrorWatchdogExpired);
}

TEST_F(Devices, AfterAnEstopErrorsAreToBeClearedFirst) {
  close_loop();
  pass_with_setpoint(100ms, 1);
  send(odrive::Estop{});
  pass(2ms);
  EXPECT_EQ(bus_.drive(0).state(), AxisState::kIdle);
  close_loop();
  pass_with_setpoint(110ms, 1);
  EXPECT_EQ(heartbeat_.state, AxisState::kIdle);
  EXPECT_EQ(heartbeat_.axis_error, odrive::kErrorEstopRequested);
  send(odrive::ClearErrors{});
  close_loop();
  pass_with_setpoint(110ms, 1);
  EXPECT_EQ(heartbeat_.state, AxisState::kClosedLoop);
}

TEST_F(Devices, AResetForgetsPositionAndLimits) {
  close_loop();
  pass_with_setpoint(1s, 1);
  bus_.drive(0).reset();
  count_.clear();
  pass(150ms);
  EXPECT_EQ(count_[0x201] + count_[0x209], 0);
  pass(200ms);
  EXPECT_EQ(heartbeat_.state, AxisState::kIdle);
  EXPECT_NEAR(estimates_.position, 0, 1e-3);
}

TEST_F(Devices, ABlockedAxisStaysAndTheMotorTurnsWithinTheBacklash) {
  close_loop();
  pass_with_setpoint(500ms, 1);
  const double angle = bus_.drive(0).plant().angle();
  bus_.drive(0).block(true);
  pass_with_setpoint(500ms, -1);
  EXPECT_EQ(bus_.drive(0).plant().angle(), angle);
  EXPECT_GT(estimates_.position, 0.9);
  bus_.drive(0).block(false);
  pass_with_setpoint(1s, -1);
  EXPECT_NEAR(estimates_.position, -1, 0.02);
}

TEST_F(Devices, TheHardStopsHold) {
  close_loop();
  pass_with_setpoint(2s, 10);
  EXPECT_LE(bus_.drive(0).plant().angle(), PlantOptions().high_stop + 1e-12);
  EXPECT_TRUE(bus_.drive(0).plant().touched_stop());
}

TEST_F(Devices, FaultsOfTheBusAndPulledPlugsSilenceWhatTheyShould) {
  pass(1s);
  bus_.drop(0.5);
  count_.clear();
  pass(1s);
  EXPECT_GT(count_[0x209], 25);
  EXPECT_LT(count_[0x209], 75);
  bus_.drop(0);
  bus_.set_bus_off(true);
  pass(1ms);
  count_.clear();
  EXPECT_EQ(bus_.send(odrive::encode({16}, odrive::Estop{}).value()), SendOutcome::kWithheld);
  pass(100ms);
  EXPECT_TRUE(count_.empty());
  EXPECT_EQ(bus_.health().bus_off, 1U);
  bus_.set_bus_off(false);
  bus_.drive(0).mute(true);
  bus_.imu().mute(true);
  pass(100ms);
  EXPECT_TRUE(count_.empty());
  bus_.drive(0).mute(false);
  bus_.imu().mute(false);
  pass(100ms);
  EXPECT_NEAR(count_[0x209], 10, 1);
  EXPECT_NEAR(count_[0x032], 10, 1);
}

TEST_F(Devices, TheImuTellsItsMotionWithBiasAndNoise) {
  ImuOptions options;
  options.frequency = 400;
  SimulatedImu imu(options, 5, now_);
  imu.move({{0.1, -0.2, 0.3}, {0, 0, 9.8}});
  std::vector<CanFrame> frames;
  imu.advance(now_ + 10s, frames);
  double sum = 0;
  double squares = 0;
  int count = 0;
  std::optional<uint32_t> last;
  for (const CanFrame& frame : frames) {
    const auto message = xsens::decode(frame).value();
    if (const auto* time = std::get_if<xsens::SampleTime>(&message)) {
      EXPECT_EQ(time->ticks - last.value_or(time->ticks - 25), 25U);  // of 0.1 ms
      last = time->ticks;
    }
    const auto* rate = std::get_if<xsens::RateOfTurn>(&message);
    if (rate == nullptr) continue;
    const double wrong = rate->rate[1] + 0.2 - imu.rate_bias()[1];
    sum += wrong;
    squares += wrong * wrong;
    ++count;
  }
  EXPECT_EQ(count, 4000);
  EXPECT_NEAR(sum / count, 0, 3e-4);
  EXPECT_NEAR(std::sqrt(squares / count), options.rate_noise, 5e-4);
  EXPECT_NE(imu.rate_bias()[1], 0);
}

TEST_F(Devices, AnImuGivesTheMeanSinceTheSampleBefore) {
  ImuOptions options;
  options.rate_noise = options.rate_bias = 0;
  SimulatedImu imu(options, 5, now_);
  std::vector<CanFrame> frames;
  for (int i = 0; i < 1000; ++i) {  // a trembling of 100 Hz would be a turn to one that samples at 100 Hz
    imu.move({{i % 10 < 5 ? 1.0 : -1.0, 0, 0}, {0, 0, 9.8}});
    imu.advance(now_ += 1ms, frames);
  }
  double most = 0;
  for (size_t i = 4; i < frames.size(); ++i) {
    const auto message = xsens::decode(frames[i]).value();
    if (const auto* rate = std::get_if<xsens::RateOfTurn>(&message))
      most = std::max(most, std::abs(rate->rate[0]));
  }
  EXPECT_LT(most, 0.01);
}

}  // namespace
}  // namespace cairn::simulated
