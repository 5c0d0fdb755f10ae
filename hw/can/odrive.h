// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <span>
#include <string>
#include <variant>

#include "hw/can/codec_fault.h"

/// ODrive's CANSimple protocol as of firmware 0.6, the part that a pan or tilt axis needs: typed messages and
/// their frames, in both directions, so that drive and host can be simulated. Pure. Turns are of the motor's
/// shaft.
namespace cairn::odrive {

/// The name of a drive on the bus, 0 to 63.
struct Node {
  uint8_t value = 0;
  auto operator<=>(const Node&) const = default;
};
constexpr uint8_t kMaxNode = 63;

enum class AxisState : uint32_t {
  kUndefined = 0,
  kIdle = 1,
  kStartupSequence = 2,
  kFullCalibration = 3,
  kMotorCalibration = 4,
  kEncoderIndexSearch = 6,
  kEncoderOffsetCalibration = 7,
  kClosedLoop = 8,
  kLockinSpin = 9,
  kEncoderDirectionFind = 10,
  kHoming = 11,
  kHallPolarityCalibration = 12,
  kHallPhaseCalibration = 13,
};

constexpr uint32_t kErrorWatchdogExpired = 0x0100'0000;
constexpr uint32_t kErrorEstopRequested = 0x0200'0000;

enum class ControlMode : uint32_t { kVoltage = 0, kTorque = 1, kVelocity = 2, kPosition = 3 };
enum class InputMode : uint32_t {
  kInactive = 0,
  kPassthrough = 1,
  kVelocityRamp = 2,
  kPositionFilter = 3,
  kTrapezoid = 5
};

// From the drive. A value that an enumeration above does not name is passed on as it is.
struct Heartbeat {
  uint32_t axis_error = 0;  ///< bits as of active_errors
  AxisState state = AxisState::kUndefined;
  uint8_t procedure_result = 0;  ///< 0 success, 1 busy; others: the manual
  bool trajectory_done = false;
  bool operator==(const Heartbeat&) const = default;
};
struct Errors {
  uint32_t active_errors = 0;
  uint32_t disarm_reason = 0;
  bool operator==(const Errors&) const = default;
};
struct EncoderEstimates {
  float position = 0;  ///< [turns]
  float velocity = 0;  ///< [turns/s]
  bool operator==(const EncoderEstimates&) const = default;
};

// To the drive.
struct Estop {
  bool operator==(const Estop&) const = default;
};
struct SetAxisState {
  AxisState state = AxisState::kIdle;
  bool operator==(const SetAxisState&) const = default;
};
struct SetControllerMode {
  ControlMode control = ControlMode::kPosition;
  InputMode input = InputMode::kPassthrough;
  bool operator==(const SetControllerMode&) const = default;
};
struct SetInputPosition {
  float position = 0;              ///< [turns]
  float velocity_feedforward = 0;  ///< [turns/s], in steps of 0.001 up to 32.767
  float torque_feedforward = 0;    ///< [Nm], likewise
  bool operator==(const SetInputPosition&) const = default;
};
/// Makes a drive forget its errors, an emergency stop among them.
struct ClearErrors {
  bool identify = false;  ///< its light blinks too
  bool operator==(const ClearErrors&) const = default;
};
struct SetLimits {
  float velocity = 0;  ///< [turns/s]
  float current = 0;   ///< [A]
  bool operator==(const SetLimits&) const = default;
};

/// What the host asks for with a remote frame, where the drive does not send it by itself.
enum class Request : uint8_t { kErrors, kEncoderEstimates };

using Message = std::variant<Heartbeat, Errors, EncoderEstimates, Estop, SetAxisState, SetControllerMode,
                             SetInputPosition, SetLimits, ClearErrors, Request>;

struct Addressed {
  Node node;
  Message message;
  bool operator==(const Addressed&) const = default;
};

/// Makes a message into a frame. Error kUsage for a node above 63, and for a number that is not finite or
/// that its field does not hold: nothing is cut off in silence on its way to a motor.
[[nodiscard]] Result<CanFrame> encode(Node node, const Message& message);
/// Reads the message of a frame from or to one of `nodes`.
[[nodiscard]] Decoded<Addressed> decode(const CanFrame& frame, std::span<const Node> nodes);

/// Passes all frames from and to that drive.
[[nodiscard]] CanFilter filter_of(Node node);

}  // namespace cairn::odrive
