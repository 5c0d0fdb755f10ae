// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

namespace cairn {

/// The limits of an axis's motion. Angles of the axis.
struct MotionLimits {
  double low = 0;           ///< hard limits: never reached [rad]
  double high = 0;          ///< [rad]
  double margin = 0;        ///< setpoints stay so far inside of them: the soft limits [rad]
  double rate = 0;          ///< [rad/s]
  double acceleration = 0;  ///< [rad/s^2]
  double coasting = 0;      ///< what friction alone slows an axis by that is let go [rad/s^2]
  double reaction = 0;      ///< of the drive: 1 over its position gain [s]
  double lag = 0;           ///< of the drive's rate behind a setpoint's that changes evenly [s]
};

/// The target of an axis: `position`, which itself moves on at `rate`; without one, a turn at `rate`.
struct Demand {
  std::optional<double> position;  ///< [rad]
  double rate = 0;                 ///< [rad/s]
};

/// The position and rate that a drive is told.
struct Setpoint {
  double position = 0;  ///< [rad]
  double rate = 0;      ///< [rad/s]
};

/// Setpoints on the way to a demand, one a period, within limits of position, rate and acceleration whatever
/// is demanded. An axis that is let go at any of them comes to rest before the hard limit. Pure.
class MotionProfile {
 public:
  /// Begins at rest at `position`, which may be beyond the soft limits: it then goes inward only.
  MotionProfile(const MotionLimits& limits, double period, double position);

  void advance(const Demand& demand);

  /// The setpoint for a drive whose axis stands at `measured` [rad]. A drive makes up for what it lags behind
  /// at 1 / reaction of that a second: one that was held, and one that missed setpoints, gets no setpoint so
  /// far ahead that it would become too fast to coast to rest before the hard limit.
  [[nodiscard]] Setpoint for_axis_at(double measured) const;

  [[nodiscard]] double position() const { return position_; }  ///< [rad]
  [[nodiscard]] double rate() const { return rate_; }          ///< [rad/s]

 private:
  [[nodiscard]] double stopping_rate(double distance) const;
  [[nodiscard]] double coasting_rate(double distance) const;
  [[nodiscard]] double highest_rate(double to_soft_limit) const;

  MotionLimits limits_;
  double period_;
  double position_;
  double rate_ = 0;
  double acceleration_ = 0;  ///< of the newest period
};

}  // namespace cairn
