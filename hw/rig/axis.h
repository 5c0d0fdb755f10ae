// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "hw/can/odrive.h"
#include "hw/rig/axis_fault.h"
#include "hw/rig/motion_profile.h"
#include "hw/rig/rig_configuration.h"
#include "hw/rig/stall_watch.h"

namespace cairn {

/// The states of an axis. In all but homing, activating and active its drive is to be idle.
namespace axis_state {
struct Unknown {};  ///< idle, not homed: where it stands is not known
struct Homing {
  MonotonicTime since;
  bool begun = false;  ///< the drive said so
};
struct Idle {};  ///< homed
struct Activating {
  MonotonicTime since;
};
struct Active {
  MotionProfile profile;
  StallWatch stall;
};
/// The drive is told to forget its errors.
struct Clearing {
  MonotonicTime since;
};
struct Faulted {
  AxisFault fault;
  uint32_t errors = 0;  ///< what the drive said, if it did
};
struct Stopped {};  ///< emergency stop
}  // namespace axis_state
using AxisState =
    std::variant<axis_state::Unknown, axis_state::Homing, axis_state::Idle, axis_state::Activating,
                 axis_state::Active, axis_state::Clearing, axis_state::Faulted, axis_state::Stopped>;

/// Pan or tilt: makes demands into messages to its drive, within the limits, and names what goes wrong.
/// Whenever motion is in doubt its drive is told to be idle until it says that it is. Pure: the clock is
/// handed in, and messages are taken out. Angles of the axis, in radians.
class Axis {
 public:
  Axis(const AxisConfiguration& configuration, const RigTuning& tuning, std::chrono::milliseconds period,
       std::chrono::milliseconds deadline, MonotonicTime now);

  // Commands. Error kRefused says what is in the way.
  [[nodiscard]] Status home(MonotonicTime now);
  [[nodiscard]] Status activate(MonotonicTime now);
  /// Sets the demand, which only an active axis follows.
  void demand(const Demand& demand) { demand_ = demand; }
  void idle();
  /// Asks the drive to clear a fault; what clears it is the drive's answer.
  void clear(MonotonicTime now);
  /// Emergency stop: at once, whatever the axis was doing, until release().
  void stop();
  void release(MonotonicTime now);

  void receive(const odrive::Message& message, MonotonicTime now);
  /// Goes on by a period that has passed.
  void advance(MonotonicTime now);
  /// The messages that are to be sent to the drive, in order.
  [[nodiscard]] std::vector<odrive::Message> take_messages() { return std::exchange(out_, {}); }

  [[nodiscard]] const AxisState& state() const { return state_; }
  [[nodiscard]] std::optional<AxisFault> fault() const;
  /// Whether its drive has been told to move and not told otherwise.
  [[nodiscard]] bool may_move() const;
  /// Whether the drive's newest heartbeat says that it is idle.
  [[nodiscard]] bool drive_is_idle() const { return drive_ == odrive::AxisState::kIdle; }
  /// The angle of the axis by the motor's encoder [rad]; nothing while that is not known. The axis is within
  /// the gear's backlash of it.
  [[nodiscard]] std::optional<double> position() const;
  /// The same angle, as it has gone on since the drive was heard.
  [[nodiscard]] std::optional<double> position_at(MonotonicTime now) const;
  [[nodiscard]] double rate() const { return rate_; }  ///< [rad/s]

 private:
  void take(const odrive::Heartbeat& heartbeat, MonotonicTime now);
  void take(const odrive::EncoderEstimates& estimates, MonotonicTime now);
  void fail_with(AxisFault fault, uint32_t errors = 0);
  void begin_clearing(MonotonicTime now);
  void leave_homing(const odrive::Heartbeat& heartbeat);
  void check_silence(MonotonicTime now);
  void check_limits();
  [[nodiscard]] bool has_jumped(double angle, MonotonicTime now) const;
  void go_on(axis_state::Homing& state, MonotonicTime now);
  void go_on(axis_state::Activating& state, MonotonicTime now);
  void go_on(axis_state::Active& state, MonotonicTime now);
  void go_on(axis_state::Clearing& state, MonotonicTime now);
  void go_on(axis_state::Stopped& state, MonotonicTime now);
  template <typename AtRest>
  void go_on(AtRest&, MonotonicTime) {
    keep_idle();
  }
  void keep_idle();
  void rest();
  void set_input(const Setpoint& setpoint);
  [[nodiscard]] double period_seconds() const { return std::chrono::duration<double>(period_).count(); }

  AxisConfiguration configuration_;
  AxisOptions options_;
  StallOptions stall_;
  std::chrono::milliseconds period_;
  std::chrono::milliseconds deadline_;
  AxisState state_;
  Demand demand_;
  bool heard_ = false;  ///< its drive has been there
  bool homed_ = false;
  std::optional<double> position_;  ///< newest, if the drive answers [rad], of a homed axis
  double rate_ = 0;
  std::optional<odrive::AxisState> drive_;  ///< as of the newest heartbeat
  uint32_t drive_errors_ = 0;
  MonotonicTime estimated_;  ///< when the drive was heard
  MonotonicTime heartbeat_;
  std::vector<odrive::Message> out_;
};

}  // namespace cairn
