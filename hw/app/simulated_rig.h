// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/se3.h"
#include "hw/can/can_bus.h"
#include "hw/rig/kinematics.h"
#include "hw/rig/rig_configuration.h"
#include "hw/simulated/simulated_bus.h"
#include "hw/simulated/wearer.h"

namespace cairn {

/// The faults that simulated devices may have.
enum class DeviceFault : uint8_t {
  kResetPan,
  kResetTilt,
  kStuckPan,
  kStuckTilt,
  kMutePan,  ///< its plug is pulled
  kMuteTilt,
  kMuteImu,
  kImuRate,  ///< half as many samples again
  kDrop,     ///< two frames of five are lost
  kBusOff,   ///< nothing comes or goes
};

struct TimedFault {
  DeviceFault what = DeviceFault::kDrop;
  std::chrono::milliseconds at{0};                 ///< since the beginning
  std::optional<std::chrono::milliseconds> lasts;  ///< nothing: to the end
};

/// "WHAT@SECONDS" or "WHAT@SECONDS+DURATION". Error kUsage, which lists the words for WHAT.
[[nodiscard]] Result<TimedFault> parse_timed_fault(std::string_view text);
/// "reset-pan, reset-tilt, ..."
[[nodiscard]] std::string list_of_device_faults();

/// The drives and the IMU of a configuration, which sits on the head as its calibration says, as nodes of any
/// CanBus, on a shoulder whose wearer walks and turns, with faults on demand. What happens to them is told as
/// lines for people. Pure: the clock is handed in.
class SimulatedRig {
 public:
  using Teller = std::function<void(const std::string&)>;

  SimulatedRig(const RigConfiguration& configuration, const std::vector<TimedFault>& faults, uint32_t seed,
               MonotonicTime now, Teller tell);

  /// Frames of the bus in and out, up to `now`.
  void turn(CanBus& bus, MonotonicTime now);
  /// A fault from now on.
  void inject(DeviceFault what, std::optional<std::chrono::milliseconds> lasts, MonotonicTime now);
  /// Does what somebody asks for from now on: "WHAT" or "WHAT+SECONDS" of a fault, "walk HZ [DEG/S]",
  /// "stand", "turn DEGREES [SECONDS]". Error kUsage.
  [[nodiscard]] Status obey(const std::string& line, MonotonicTime now);
  /// The angles of the head on the base, behind the gears' backlash [rad].
  [[nodiscard]] PanTilt head();
  /// The true pose of its camera at the time of the last turn(), in the world of Wearer.
  [[nodiscard]] SE3 world_from_camera();
  /// Tells where each axis has been, and whether it lay at its hard stop: a line each.
  void tell_extremes();

 private:
  struct Seen {
    odrive::AxisState state = odrive::AxisState::kIdle;
    double least = 0;  ///< angle of the axis [deg]
    double most = 0;
  };

  [[nodiscard]] Status inject(const std::string& line, MonotonicTime now);
  void set(DeviceFault what, bool on);
  void move_imu();
  void look();
  void say(const std::string& what);
  [[nodiscard]] double angle(AxisName name);
  [[nodiscard]] double seconds() const { return std::chrono::duration<double>(now_ - start_).count(); }

  RigConfiguration configuration_;
  simulated::SimulatedBus bus_;
  simulated::Wearer wearer_;
  MonotonicTime start_;
  MonotonicTime now_;
  Teller tell_;
  std::vector<TimedFault> to_come_;
  std::vector<TimedFault> to_end_;  ///< `at`: when
  std::array<Seen, 2> seen_;
};

}  // namespace cairn
