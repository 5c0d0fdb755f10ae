// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cairn::simulated {

/// A motor, its gear and the axis behind it. Motor side in turns of the shaft, axis side in radians.
struct PlantOptions {
  double turns_per_radian = 3.2;  ///< of the gear, above 0
  double acceleration = 20;       ///< of the shaft with all that it turns [turns/s^2 per A]
  double friction = 20;           ///< slows the shaft whatever its rate [turns/s^2]
  double damping = 0.5;           ///< slows the shaft in proportion to its rate [1/s]
  double backlash = 0.0052;       ///< of the gear, as seen at the axis [rad]
  double low_stop = -1.05;        ///< hard stops of the axis [rad]
  double high_stop = 1.05;
  double start = 0;  ///< angle of the axis at first [rad]
};

/// Simulates how the axis turns when a current flows. The axis stays where it is while the gear crosses its
/// backlash, as one with friction does. Pure.
class AxisPlant {
 public:
  explicit AxisPlant(const PlantOptions& options);

  /// Goes on by `step` [s], a millisecond or less, with a constant current [A].
  void advance(double current, double step);
  /// Sets whether something holds the axis; the motor still turns within the backlash.
  void block(bool blocked) { blocked_ = blocked; }

  [[nodiscard]] double shaft() const { return shaft_; }            ///< [turns] since the beginning
  [[nodiscard]] double shaft_rate() const { return shaft_rate_; }  ///< [turns/s]
  [[nodiscard]] double angle() const { return angle_; }            ///< of the axis [rad]
  [[nodiscard]] double rate() const { return rate_; }              ///< of the axis [rad/s]
  /// Whether the axis ever lay at a hard stop.
  [[nodiscard]] bool touched_stop() const { return touched_stop_; }

 private:
  [[nodiscard]] double shaft_at(double angle) const;

  PlantOptions options_;
  double shaft_ = 0;
  double shaft_rate_ = 0;
  double angle_;
  double rate_ = 0;
  bool blocked_ = false;
  bool touched_stop_ = false;
};

}  // namespace cairn::simulated
