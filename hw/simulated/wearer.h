// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "hw/simulated/gait.h"

namespace cairn::simulated {

/// The wearer of a simulated shoulder: stands two metres from a point and faces it, walks around it or on the
/// spot, and turns aside, as asked. World and base as of Gait; times [s] on one clock, each no earlier than
/// that of the call before. Pure.
class Wearer {
 public:
  /// Sways so often [Hz], above 0, and goes around the point by `turn` [rad/s]; who walks already comes to
  /// rest first.
  void walk(double frequency, double turn, double now);
  /// Comes to rest within a second.
  void stand(double now);
  /// Turns by so much to the left of where the wearer faces [rad], within `time` [s], above 0, as a body does
  /// (minimum jerk).
  void turn(double angle, double time, double now);

  [[nodiscard]] Eigen::Quaterniond world_from_base(double t) const;
  [[nodiscard]] Eigen::Vector3d position(double t) const;
  /// Rate of turn [rad/s], and acceleration [m/s^2] with the pull that holds the base up, both in the base's
  /// axes.
  [[nodiscard]] Eigen::Vector3d rate(double t) const;
  [[nodiscard]] Eigen::Vector3d acceleration(double t) const;

 private:
  struct Leg {
    double begin;
    Gait gait;
  };
  struct Turn {
    double begin;
    double time;
    double angle;
  };
  [[nodiscard]] const Leg& leg_at(double t) const;
  /// When the last leg is over, if it ends.
  [[nodiscard]] std::optional<double> rests_at() const;
  void forget(double now);
  [[nodiscard]] double turned(double t) const;

  std::deque<Leg> legs_{Leg{0, {.radius = 2}}};  ///< never empty
  std::deque<Turn> turns_;
  double turned_before_ = 0;  ///< by those that are over and forgotten [rad]
};

}  // namespace cairn::simulated
