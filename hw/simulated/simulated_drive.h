// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/time.h"
#include "hw/can/frame.h"
#include "hw/can/odrive.h"
#include "hw/simulated/axis_plant.h"

namespace cairn::simulated {

struct DriveOptions {
  odrive::Node node{16};
  PlantOptions plant;
  double switch_angle = -1.0;     ///< the axis is at its homing switch here and below [rad]
  double homing_rate = 1;         ///< [turns/s]
  double velocity_limit = 20;     ///< of the drive itself; SetLimits may lower it [turns/s]
  double current_limit = 10;      ///< likewise [A]
  double position_gain = 20;      ///< [1/s]
  double velocity_gain = 7.5;     ///< [A per turn/s]
  double integrator_gain = 37.5;  ///< of the rate's error [A per turn]: what friction takes is given back
  double counts_per_turn = 8192;  ///< of the encoder, which is on the motor's shaft
  std::chrono::milliseconds heartbeat{100};
  std::chrono::milliseconds estimates{10};  ///< 0: only when asked for
  std::chrono::milliseconds watchdog{50};   ///< without a setpoint so long, closed loop ends; 0: none
  std::chrono::milliseconds boot{200};      ///< deaf and dumb after a reset
};

/// A drive that speaks CANSimple as ODrive's firmware 0.6 does, with its motor and axis, in simulated time.
/// It knows its position since it was switched on only, until it is homed: 0 is then the homing switch. It
/// calculates in steps of a millisecond; same options, seed and calls, same frames.
class SimulatedDrive {
 public:
  /// Switched on at `now`. The seed sets when its cyclic messages fall due.
  SimulatedDrive(const DriveOptions& options, uint32_t seed, MonotonicTime now);

  /// A frame of the bus; those to other nodes and those that no drive understands are passed over. What it
  /// answers comes with the next advance().
  void receive(const CanFrame& frame);
  /// Goes on to `now`, and appends what it sends meanwhile.
  void advance(MonotonicTime now, std::vector<CanFrame>& out);

  // Faults.
  /// Starts anew, as after a dip of its supply.
  void reset();
  /// Something holds its axis.
  void block(bool blocked) { plant_.block(blocked); }
  /// Neither sends nor receives, as with its plug pulled; it goes on otherwise.
  void mute(bool muted) { muted_ = muted; }

  [[nodiscard]] const AxisPlant& plant() const { return plant_; }
  [[nodiscard]] odrive::AxisState state() const { return state_; }
  [[nodiscard]] uint32_t errors() const { return errors_; }

 private:
  struct Input {
    double position = 0;  ///< [turns] of its estimate
    double velocity = 0;  ///< [turns/s]
    double current = 0;   ///< [A]
  };

  void handle(const odrive::Estop&) { disarm(odrive::kErrorEstopRequested); }
  void handle(const odrive::SetAxisState& message);
  void handle(const odrive::SetControllerMode& message) { mode_ = message; }
  void handle(const odrive::SetInputPosition& message);
  void handle(const odrive::SetLimits& message);
  void handle(const odrive::ClearErrors&) { errors_ = disarm_reason_ = 0; }
  void handle(odrive::Request request);
  template <typename FromDrive>
  void handle(const FromDrive&) {}  // of the other direction

  void step();
  void step_homing();
  void disarm(uint32_t error);
  void send_due(std::vector<CanFrame>& out);
  void send(const odrive::Message& message, std::vector<CanFrame>& out) const;
  [[nodiscard]] double position() const { return plant_.shaft() - zero_; }
  [[nodiscard]] odrive::Message estimates() const;
  [[nodiscard]] double current_for(const Input& input);

  DriveOptions options_;
  AxisPlant plant_;
  MonotonicTime now_;
  MonotonicTime next_heartbeat_;
  MonotonicTime next_estimates_;
  MonotonicTime fed_;
  std::optional<MonotonicTime> boots_until_;
  std::vector<odrive::Request> asked_;
  odrive::AxisState state_ = odrive::AxisState::kIdle;
  odrive::SetControllerMode mode_;
  odrive::SetLimits limits_;
  Input input_;
  double integral_ = 0;  ///< [A]
  double zero_ = 0;      ///< shaft at position 0 [turns]
  bool leaves_switch_ = false;
  bool muted_ = false;
  uint8_t result_ = 0;
  uint32_t errors_ = 0;
  uint32_t disarm_reason_ = 0;
};

}  // namespace cairn::simulated
