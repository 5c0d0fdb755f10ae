// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/wire/rig_messages.h"
#include "hw/app/imu_clock.h"
#include "hw/calibration/clock_offset.h"
#include "hw/rig/imu_sampler.h"
#include "hw/rig/rig.h"

namespace cairn {

/// The rig as its commanders know it: orders of the wire and frames of the bus in, states and frames out. A
/// new order is carried out or refused, once; said again it is a sign of life. Pure: the clock is handed in.
class RigBridge {
 public:
  RigBridge(const RigConfiguration& configuration, MonotonicTime now);

  /// `seen`: when the target was seen, by the clock of `now`; counts for fixate.
  void obey(const wire::RigCommand& command, MonotonicTime now, MonotonicTime seen);
  void obey(const wire::RigCommand& command, MonotonicTime now) { obey(command, now, now); }
  /// Orders of other sessions are refused from now on, but for an emergency stop: a calibration has the rig
  /// for itself, whatever its tracker would have it do.
  void reserve_for(SessionId session) { reserved_for_ = session; }
  /// Emergency stop by somebody at the rig itself.
  void stop(MonotonicTime now);
  /// The program ends: the drives are let go, and no order is taken any more.
  void close(MonotonicTime now);
  /// Whether the drives are let go after close(): they have said so, if they were told to move.
  [[nodiscard]] bool is_let_go(MonotonicTime now) const;

  void receive(const ReceivedFrame& frame, MonotonicTime now);
  /// Takes the clock's offset as it is estimated while the rig is at work: it counts for what is seen from
  /// now on, and is reported. One that is not known withdraws it, and what the configuration says counts
  /// again.
  void set_camera_clock(const wire::RigCameraClock& clock);
  /// The rates that the gyro measured since the last call, in its own axes, with stamps of the host; only the
  /// newest of them where nobody has asked for long.
  [[nodiscard]] std::vector<GyroSample> take_gyro();
  void advance(MonotonicTime now) { rig_.advance(now); }
  [[nodiscard]] MonotonicTime next_due() const { return rig_.next_due(); }
  [[nodiscard]] std::vector<OutgoingFrame> take_frames() { return rig_.take_frames(); }

  /// Sets the trouble of the bus, in words; empty: none. It is told before what is wrong with the rig.
  void set_bus_trouble(std::string trouble) { bus_trouble_ = std::move(trouble); }
  [[nodiscard]] wire::RigState state(Timestamp host_time) const;
  [[nodiscard]] const Rig& rig() const { return rig_; }

 private:
  [[nodiscard]] Status carry_out(const wire::RigCommand& command, const std::string& who, MonotonicTime now);
  [[nodiscard]] Status aim(const wire::RigCommand& command, const std::string& who, MonotonicTime now);
  [[nodiscard]] Status move_target(const wire::RigCommand& command, const std::string& who, MonotonicTime now,
                                   MonotonicTime seen);
  [[nodiscard]] Pointing pointing_of(const wire::RigCommand& command) const;
  void sense(const xsens::Message& message, Timestamp received);
  void keep(const ImuSample& sample);
  void tell_tracker(wire::RigState* state) const;
  [[nodiscard]] wire::RigMode mode() const;
  [[nodiscard]] bool may_move() const;
  [[nodiscard]] bool is_new(const wire::CommandId& order);

  RigConfiguration configuration_;
  Rig rig_;
  bool closed_ = false;
  std::optional<MonotonicTime> let_go_;        ///< when, if the drives were told to move until then
  wire::RigMode mode_ = wire::RigMode::kIdle;  ///< of the order that holds
  std::string commander_;                      ///< name of who gave it
  wire::CommandId judged_;                     ///< the newest order
  std::string refusal_;                        ///< of that, and likewise:
  std::string ordered_by_;
  wire::RigMode ordered_ = wire::RigMode::kIdle;
  std::deque<wire::CommandId> newest_;  ///< of each of the last sessions
  std::string bus_trouble_;
  std::optional<SessionId> reserved_for_;
  ImuClock imu_clock_;
  std::optional<wire::RigImu> imu_;
  std::vector<GyroSample> gyro_;
  ImuSampler sampler_;
  std::deque<wire::RigImuSample> samples_;  ///< the newest
  wire::RigCameraClock camera_clock_;
  wire::RigCommand said_;  ///< the order that holds, as it was said last
};

}  // namespace cairn
