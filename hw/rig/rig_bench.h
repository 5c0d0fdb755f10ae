// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "hw/rig/rig.h"
#include "hw/rig/test_rig.h"
#include "hw/simulated/gait.h"
#include "hw/simulated/simulated_bus.h"

// For tests only.
namespace cairn::testing {

constexpr double kDegree = std::numbers::pi / 180;

/// The devices of kRigText. The tilt's motor turns the other way: its plant's angle is that of the axis
/// negated.
inline std::vector<simulated::DriveOptions> sound_drives(double pan, double tilt) {
  simulated::DriveOptions options;
  options.plant.turns_per_radian = 20 / (2 * std::numbers::pi);
  options.node = {16};
  options.switch_angle = -56 * kDegree;
  options.plant.low_stop = -60 * kDegree;
  options.plant.high_stop = 60 * kDegree;
  options.plant.start = pan;
  std::vector<simulated::DriveOptions> drives = {options, options};
  drives[1].node = {17};
  drives[1].switch_angle = -36 * kDegree;
  drives[1].plant.low_stop = -42 * kDegree;
  drives[1].plant.high_stop = 42 * kDegree;
  drives[1].plant.start = -tilt;
  return drives;
}

using simulated::Gait;

/// A rig, its commander and simulated devices, joined by frames alone, in simulated time. That no axis is
/// ever beyond its hard limits is checked at each millisecond.
class RigBench {
 public:
  explicit RigBench(uint32_t seed, double pan = 0, double tilt = 0, const std::string& text = kRigText)
      : configuration_(read_rig(text).value()),
        bus_(sound_drives(pan, tilt), {}, seed, now_),
        rig_(configuration_, now_) {}

  [[nodiscard]] Status command(decltype(RigCommand::what) what) {
    Status done = rig_.take({commander, std::move(what)}, now_);
    send();
    return done;
  }
  void millisecond() { step(std::chrono::milliseconds(1)); }
  /// A millisecond is a whole number of steps.
  void step(std::chrono::microseconds time) {
    now_ += time;
    move_imu();
    bus_.advance(now_);
    while (const auto got = bus_.receive()) rig_.receive(got->frame, now_);
    if (commander_lives &&
        (now_ - MonotonicTime()) % std::chrono::milliseconds(20) == std::chrono::nanoseconds(0)) {
      EXPECT_TRUE(command(rig_command::Stay{}));
    }
    rig_.advance(now_);
    send();
    check_limits();
  }
  void pass(std::chrono::milliseconds time) {
    for (; time.count() > 0; --time) millisecond();
  }
  /// The host does nothing, the world goes on.
  void pause(std::chrono::milliseconds time) {
    now_ += time;
    bus_.advance(now_);
  }
  /// The time until `condition` held; nothing if that took longer than `most`.
  std::optional<std::chrono::milliseconds> until(const std::function<bool()>& condition,
                                                 std::chrono::milliseconds most) {
    for (std::chrono::milliseconds passed(0); passed <= most; ++passed) {
      if (condition()) return passed;
      millisecond();
    }
    return std::nullopt;
  }
  /// Homes and activates both axes; they stay at rest.
  void start() {
    pass(std::chrono::milliseconds(200));
    ASSERT_TRUE(command(rig_command::Home{}));
    ASSERT_TRUE(until([&] { return both<axis_state::Idle>(); }, std::chrono::seconds(30))) << rig_.describe();
    pass(std::chrono::milliseconds(50));
    const Status active = command(rig_command::Activate{});
    ASSERT_TRUE(active) << active.error().message;
    ASSERT_TRUE(until([&] { return both<axis_state::Active>(); }, std::chrono::seconds(1)))
        << rig_.describe();
  }
  void point(const Demand& pan, const Demand& tilt) { EXPECT_TRUE(command(rig_command::Point{{pan, tilt}})); }

  template <typename State>
  [[nodiscard]] bool both() const {
    return std::holds_alternative<State>(rig_.axis(AxisName::kPan).state()) &&
           std::holds_alternative<State>(rig_.axis(AxisName::kTilt).state());
  }
  /// Whether an axis is idle and has no fault.
  [[nodiscard]] bool is_at_rest(AxisName name) const {
    const AxisState& state = rig_.axis(name).state();
    return std::holds_alternative<axis_state::Idle>(state) ||
           std::holds_alternative<axis_state::Unknown>(state);
  }
  [[nodiscard]] bool drives_are_idle() {
    return bus_.drive(0).state() == odrive::AxisState::kIdle &&
           bus_.drive(1).state() == odrive::AxisState::kIdle;
  }
  /// True angle of an axis [rad].
  [[nodiscard]] double angle(AxisName name) {
    return name == AxisName::kPan ? bus_.drive(0).plant().angle() : -bus_.drive(1).plant().angle();
  }
  [[nodiscard]] PanTilt angles() { return {angle(AxisName::kPan), angle(AxisName::kTilt)}; }
  /// The wearer walks from now on.
  void walk(const Gait& gait) {
    gait_ = gait;
    set_out_ = now_;
  }
  /// The true attitude of the shoulder.
  [[nodiscard]] Eigen::Quaterniond world_from_base() const { return gait_.world_from_base(walked()); }
  /// The shoulder's place, from the point that the wearer walks around [m].
  [[nodiscard]] Eigen::Vector3d position() const { return gait_.position(walked()); }
  /// The direction in which the camera truly looks.
  [[nodiscard]] Eigen::Vector3d view() { return world_from_camera() * Eigen::Vector3d::UnitZ(); }
  [[nodiscard]] Eigen::Quaterniond world_from_camera() {
    return world_from_base() * base_from_head(angles()) * configuration_.calibration.head_from_camera;
  }
  [[nodiscard]] std::optional<AxisFault> fault(AxisName name) const { return rig_.axis(name).fault(); }
  [[nodiscard]] Rig& rig() { return rig_; }
  [[nodiscard]] simulated::SimulatedBus& bus() { return bus_; }
  [[nodiscard]] MonotonicTime now() const { return now_; }

  bool commander_lives = true;
  std::string commander = "tracker";

 private:
  inline static const Eigen::Vector3d kUp{0, 0, 9.81};  // [m/s^2]

  [[nodiscard]] double walked() const { return std::chrono::duration<double>(now_ - set_out_).count(); }
  /// Moves the IMU with the head, on which it sits.
  void move_imu() {
    const PanTilt rates{bus_.drive(0).plant().rate(), -bus_.drive(1).plant().rate()};
    const Eigen::Quaterniond imu_from_head = configuration_.calibration.head_from_imu.conjugate();
    const auto position = [this](double t) { return gait_.position(t); };
    const Eigen::Vector3d pull = simulated::acceleration_of(position, walked()) + kUp;
    const HeadMotion base{simulated::rate_of([this](double t) { return gait_.world_from_base(t); }, walked()),
                          world_from_base().conjugate() * pull};
    const HeadMotion head = motion_of_head(angles(), rates, base);
    const Eigen::Vector3d rate = imu_from_head * head.rate;
    const Eigen::Vector3d acceleration = imu_from_head * head.acceleration;
    bus_.imu().move({{rate.x(), rate.y(), rate.z()}, {acceleration.x(), acceleration.y(), acceleration.z()}});
  }
  void send() {
    // One that is withheld is not sent again: the rig says idle and stop until the drive obeys.
    for (const OutgoingFrame& out : rig_.take_frames())
      ASSERT_NE(bus_.send(out.frame, out.urgency), SendOutcome::kInvalid);
  }
  void check_limits() {
    for (const AxisName name : kAxisNames) {
      const MotionLimits& limits = configuration_.axis(name).limits;
      ASSERT_GE(angle(name), limits.low) << to_string(name);
      ASSERT_LE(angle(name), limits.high) << to_string(name);
    }
  }

  MonotonicTime now_{std::chrono::hours(1)};
  RigConfiguration configuration_;
  simulated::SimulatedBus bus_;
  Rig rig_;
  Gait gait_;
  MonotonicTime set_out_ = now_;
};

}  // namespace cairn::testing
