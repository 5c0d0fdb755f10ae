// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "hw/can/can_bus.h"
#include "hw/rig/attitude.h"
#include "hw/rig/axis.h"
#include "hw/rig/backlash.h"
#include "hw/rig/imu_sampler.h"
#include "hw/rig/imu_watch.h"
#include "hw/rig/pointer.h"
#include "hw/rig/rig_configuration.h"

namespace cairn {

/// The commands that a commander may give a rig.
namespace rig_command {
struct Stay {};  ///< nothing new; I am there
struct Home {};
struct Activate {};
struct Idle {};
struct Point {
  std::array<Demand, 2> demands;  ///< by AxisName
};
/// The rig points the camera by itself from now on, until it is activated anew or takes a Point. The same
/// mode again moves its target.
struct Aim {
  Pointing pointing;
};
/// A sighting of the point to fixate.
struct Sight {
  Sighting sighting;
};
struct ClearFaults {};
/// Emergency stop: at once, by anybody, until it is cleared.
struct Stop {};
struct ClearStop {
  std::string rig;  ///< its name, so that no other rig is meant
};
}  // namespace rig_command

struct RigCommand {
  std::string commander;
  std::variant<rig_command::Stay, rig_command::Home, rig_command::Activate, rig_command::Idle,
               rig_command::Point, rig_command::Aim, rig_command::Sight, rig_command::ClearFaults,
               rig_command::Stop, rig_command::ClearStop>
      what;
};

/// Why the rig idled its drives, until it is activated or homed again.
enum class Halt : uint8_t {
  kCommanderSilent,
  kImuSilent,
  kImuRate,
  kAxisFault,
  kClockRanBack,
};
/// Says what is wrong and what helps.
[[nodiscard]] const char* describe(Halt halt);

struct OutgoingFrame {
  CanFrame frame;
  Urgency urgency = Urgency::kRoutine;
};

/// Counters since the beginning.
struct RigCounters {
  uint64_t strange_frames = 0;  ///< from nodes that are not of the rig, or no messages
  uint64_t late = 0;            ///< times that advance() came several periods late
};

/// The rig without bus, threads and clock: commands and frames in, frames out. The IMU sits on the head,
/// which the tilt axis turns, as the configuration's calibration says. The rig's watchdog idles both drives
/// when commander, IMU or a drive is silent for longer than its deadline, when an axis has a fault, and when
/// time runs back. What has come is to be handed in before advance(), which takes silence for death.
class Rig {
 public:
  Rig(const RigConfiguration& configuration, MonotonicTime now);

  /// Carries out a command. Each one taken is a sign of life of its commander. Errors: kRefused for one
  /// beside a commander that is alive, and for what state or faults do not allow; nothing has changed then.
  [[nodiscard]] Status take(const RigCommand& command, MonotonicTime now);
  void receive(const CanFrame& frame, MonotonicTime now);
  /// Sets what must be added to a stamp of the camera to get the IMU's, as it was measured since the
  /// configuration was written. It counts for sightings from now on.
  void set_camera_offset(std::chrono::nanoseconds offset) { pointer_.set_camera_offset(offset); }
  /// Does what fell due until `now`.
  void advance(MonotonicTime now);
  /// When something falls due. Where a period is a whole number of the IMU's samples, that falls in step with
  /// them: setpoints go out right behind the sample that they are made from.
  [[nodiscard]] MonotonicTime next_due() const { return next_; }
  /// The frames to be sent, in order. What the bus withholds need not be kept: idle and stop are said again
  /// each period until the drive obeys.
  [[nodiscard]] std::vector<OutgoingFrame> take_frames();

  [[nodiscard]] const Axis& axis(AxisName name) const { return axes_.at(static_cast<size_t>(name)); }
  /// The angles of the axes by their encoders, at the time of the last advance(); nothing where one is not
  /// homed, or has a fault.
  [[nodiscard]] std::optional<PanTilt> angles() const;
  /// The attitude of the head, by the IMU on it.
  [[nodiscard]] const Attitude& attitude() const { return attitude_; }
  [[nodiscard]] const BaseMotion& base() const { return pointer_.base(); }
  /// How the mode that was aimed goes; nothing where demands come from the commander.
  [[nodiscard]] std::optional<PointingState> pointing() const { return pointer_.state(); }
  [[nodiscard]] bool is_stopped() const { return stopped_; }
  [[nodiscard]] std::optional<Halt> halt() const { return halt_; }
  [[nodiscard]] const std::string& commander() const { return commander_; }  ///< empty: none
  [[nodiscard]] const RigCounters& counters() const { return counters_; }
  /// The newest of RigCounters::strange_frames in words; empty: there was none.
  [[nodiscard]] std::string describe_strange() const;
  /// Says to people in one line what keeps the rig from moving and what helps; empty when nothing does.
  [[nodiscard]] std::string describe() const;

 private:
  [[nodiscard]] Status handle(const rig_command::Stay&, MonotonicTime) { return {}; }
  [[nodiscard]] Status handle(const rig_command::Home&, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::Activate&, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::Idle&, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::Point& point, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::Aim& aim, MonotonicTime) {
    return pointer_.aim(aim.pointing);
  }
  [[nodiscard]] Status handle(const rig_command::Sight& sight, MonotonicTime) {
    return pointer_.see(sight.sighting);
  }
  [[nodiscard]] Status handle(const rig_command::ClearFaults&, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::Stop&, MonotonicTime now);
  [[nodiscard]] Status handle(const rig_command::ClearStop& clear, MonotonicTime now);

  [[nodiscard]] Status begin(Status (Axis::*what)(MonotonicTime), MonotonicTime now);
  [[nodiscard]] Status ready() const;
  [[nodiscard]] bool may_move() const;
  [[nodiscard]] std::optional<Halt> what_is_wrong(MonotonicTime now) const;
  [[nodiscard]] std::optional<Halt> imu_trouble(MonotonicTime now) const;
  void sense(const xsens::Message& message, MonotonicTime now);
  /// The angles of the axes, behind the play of their gears.
  [[nodiscard]] std::optional<PanTilt> angles_at(MonotonicTime now);
  /// The head's turn by its axes since the IMU's sample before [rad, a rotation vector in the head's axes]; 0
  /// where it is not known.
  [[nodiscard]] Eigen::Vector3d turn_of_head(const std::optional<PanTilt>& angles) const;
  void aim(MonotonicTime now);
  void fall_in_step(MonotonicTime sampled);
  void watch(MonotonicTime now);
  void halt_for(Halt reason);
  void collect();

  RigConfiguration configuration_;
  std::vector<odrive::Node> nodes_;
  std::array<Axis, 2> axes_;
  std::optional<ImuWatch> imu_;
  ImuSampler sampler_;
  Attitude attitude_;
  std::optional<PanTilt> angles_;  ///< at the IMU's newest sample
  std::array<Backlash, 2> backlash_;
  Pointer pointer_;
  MonotonicTime now_;
  MonotonicTime next_;
  std::string commander_;
  MonotonicTime commanded_;
  bool stopped_ = false;
  std::optional<Halt> halt_;
  RigCounters counters_;
  std::optional<CanFrame> strange_;
  std::vector<OutgoingFrame> out_;
};

}  // namespace cairn
