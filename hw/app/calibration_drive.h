// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/wire/rig_messages.h"
#include "hw/app/rig_host.h"
#include "hw/calibration/calibration_tour.h"

namespace cairn {

/// A rig's state as a tour takes it. `mine`: the newest order of the tour; refusals of others' orders are
/// none of its.
[[nodiscard]] TourReport report_of(const wire::RigState& state, const wire::CommandId& mine, Timestamp when);
/// `when`: of the image, by the clock of the tour.
[[nodiscard]] TourPose pose_of(const wire::TrackerStateMessage& state, Timestamp when);

/// A session that no other process has.
[[nodiscard]] SessionId random_session();

/// Makes a tour's orders into those of a commander.
class TourCommander {
 public:
  TourCommander(std::string rig, SessionId session);
  /// The order that is to be said again and again; nothing where the tour wants nothing.
  [[nodiscard]] std::optional<wire::RigCommand> say(const TourOrder& order);
  [[nodiscard]] const wire::CommandId& newest() const { return command_.order; }

 private:
  wire::RigCommand command_;
  TourOrder::What what_ = TourOrder::What::kNothing;
};

/// Runs a tour on a rig of this process.
class CalibrationDrive {
 public:
  struct Person {
    std::function<bool(const std::string&)> agrees;  ///< to what the axes will do
    std::function<void(const std::string&)> hears;
    std::function<bool()> interrupts;
  };

  /// Starts the host, which outlives it. `session`: of its orders; the host is reserved for it.
  CalibrationDrive(RigHost& host, ScaledClock clock, SessionId session);
  ~CalibrationDrive() { host_.leave_network(); }
  CalibrationDrive(const CalibrationDrive&) = delete;
  CalibrationDrive& operator=(const CalibrationDrive&) = delete;

  /// Errors: those of CalibrationTour, and kRefused where the person does not agree or interrupts.
  [[nodiscard]] Result<TourFindings> run(const RigConfiguration& configuration, const Person& person);

 private:
  [[nodiscard]] Timestamp now() const { return {clock_.now().time_since_epoch().count()}; }
  void hand_in(CalibrationTour* tour);

  RigHost& host_;
  const ScaledClock clock_;
  const SessionId session_;
  std::optional<TourCommander> commander_;
  std::mutex mutex_;  ///< for what follows
  std::optional<wire::RigState> state_;
  std::vector<TourPose> poses_;
};

}  // namespace cairn
