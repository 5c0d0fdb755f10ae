// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "common/base/time.h"
#include "hw/rig/rig_tuning.h"

namespace cairn {

/// Estimates where a point of the world is, seen from a camera that walks: from sightings that come late, and
/// between them by the camera's speed. Pure.
class TargetTrack {
 public:
  explicit TargetTrack(const TargetTrackOptions& options) : options_(options) {}

  /// The point from the camera, in the world's axes, as it was at `when`. An older one than the newest is
  /// left out.
  void see(MonotonicTime when, const Eigen::Vector3d& target);
  void forget() { seen_.reset(); }

  struct Estimate {
    Eigen::Vector3d target;  ///< from the camera, in the unit of the sightings
    Eigen::Vector3d rate;    ///< of that, a second
  };
  /// The estimate at a time; nothing before the first sighting. Long after the last one the point stays in
  /// its direction.
  [[nodiscard]] std::optional<Estimate> at(MonotonicTime when) const;
  [[nodiscard]] bool is_seen(MonotonicTime now) const;

 private:
  TargetTrackOptions options_;
  std::optional<MonotonicTime> seen_;
  Eigen::Vector3d target_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d rate_ = Eigen::Vector3d::Zero();
};

}  // namespace cairn
