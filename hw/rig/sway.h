// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Estimates how the steps of a wearer carry the head to and fro: what is quick in its way, from its
/// accelerations. Where it is in the end, they do not tell. Pure.
class Sway {
 public:
  explicit Sway(const BaseOptions& options) : forgotten_(options.sway_forgotten) {}

  /// Takes an acceleration in the world's axes, without gravity [m/s^2], mean of the last `step` [s].
  void update(const Eigen::Vector3d& acceleration, double step);

  [[nodiscard]] const Eigen::Vector3d& way() const { return way_; }    ///< [m], from somewhere
  [[nodiscard]] const Eigen::Vector3d& rate() const { return rate_; }  ///< [m/s]

 private:
  double forgotten_;  ///< [s]
  Eigen::Vector3d way_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
};

}  // namespace cairn
