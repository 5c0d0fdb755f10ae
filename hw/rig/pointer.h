// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>

#include "common/base/result.h"
#include "common/base/time.h"
#include "hw/rig/base_motion.h"
#include "hw/rig/head_history.h"
#include "hw/rig/motion_profile.h"
#include "hw/rig/pointing.h"
#include "hw/rig/rig_configuration.h"
#include "hw/rig/search_plan.h"
#include "hw/rig/sway.h"
#include "hw/rig/target_track.h"

namespace cairn {

/// Makes modes and targets into demands of the axes. What is demanded stays within nothing: limits are the
/// axes' own. Pure: the clock is handed in.
class Pointer {
 public:
  explicit Pointer(const RigConfiguration& configuration);

  /// Sets what the camera is to look at. Errors: kRefused for what is no direction or no number, and for what
  /// needs an IMU that the rig has not.
  [[nodiscard]] Status aim(const Pointing& pointing);
  /// Takes a sighting. Error kRefused for one that is of the future, older than what is remembered of the
  /// head, or no direction.
  [[nodiscard]] Status see(const Sighting& sighting);
  /// Sets the offset of RigCalibration as it was measured since. It counts for sightings from now on.
  void set_camera_offset(std::chrono::nanoseconds offset) { configuration_.calibration.offset = offset; }
  /// Forgets what a search has looked at: the next one, or that which goes on, begins anew.
  void forget_search();
  /// Looks at nothing any more: demands come from others now.
  void let_go() { pointing_.reset(); }

  /// Takes a sample of the IMU, with the acceleration in the head's axes [m/s^2, up at rest].
  void sense(MonotonicTime now, const Eigen::Quaterniond& world_from_head,
             const Eigen::Vector3d& acceleration, const PanTilt& angles, double step);
  /// The demands as of `then`, from which a MotionProfile goes on by a period; nothing while nothing is aimed
  /// at. `pan`: where pan stands [rad].
  [[nodiscard]] std::optional<std::array<Demand, 2>> demands(MonotonicTime then, double pan);

  [[nodiscard]] const BaseMotion& base() const { return base_; }
  /// How the mode goes; nothing while nothing is aimed at.
  [[nodiscard]] std::optional<PointingState> state() const;

 private:
  using Demands = std::array<Demand, 2>;
  /// The direction to look along, in the world's axes.
  struct Target {
    Eigen::Vector3d direction;
    Eigen::Vector3d moving = Eigen::Vector3d::Zero();  ///< [1/s] in the unit of the direction
  };

  [[nodiscard]] Target target_of(const pointing::Follow&, double step);
  [[nodiscard]] Target target_of(const pointing::Fixate&, double step);
  [[nodiscard]] Target target_of(const pointing::Search&, double step);
  template <typename Holding>
  [[nodiscard]] Target target_of(const Holding&, double) {
    return {held_};
  }
  [[nodiscard]] Demands towards(const Target& target, double pan);
  void begin();
  /// Takes the search on to its next place.
  void look_at_next();
  [[nodiscard]] double time_to(const Eigen::Vector3d& direction) const;
  void judge(const Eigen::Vector3d& direction, double step);
  [[nodiscard]] bool is_within_reach(const Eigen::Vector3d& direction) const;
  [[nodiscard]] Eigen::Vector3d view() const { return world_from_head_ * camera_axis_; }

  RigConfiguration configuration_;
  Eigen::Vector3d camera_axis_;  ///< in the head
  std::optional<Pointing> pointing_;
  bool begun_ = false;
  BaseMotion base_;
  Eigen::Quaterniond world_from_head_ = Eigen::Quaterniond::Identity();
  HeadHistory history_;
  Sway sway_;
  MonotonicTime sampled_;
  MonotonicTime then_;
  double ahead_ = 0;                                 ///< of `then_` to the newest sample [s]
  Eigen::Vector3d held_ = Eigen::Vector3d::UnitX();  ///< the direction that the mode keeps
  TargetTrack track_;
  std::optional<SearchPlan> plan_;
  std::optional<MonotonicTime> searched_;  ///< when last
  double on_target_for_ = 0;               ///< [s]
  double sought_for_ = 0;                  ///< search: since the axes can be at this place [s]
  PointingState state_;
};

}  // namespace cairn
