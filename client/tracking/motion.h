// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/tiny_image.h"

namespace cairn {

/// Decaying constant velocity in real time stamps (PTAM's counts frames and so breaks when frames are
/// dropped; PTAM r114).
class MotionModel {
 public:
  /// Camera motion from the last pose to `time`, by the velocity.
  [[nodiscard]] SE3 predicted_step(Timestamp time) const;
  /// The same with a turn that is known (of the camera, now from before) and not foretold.
  [[nodiscard]] SE3 predicted_step(Timestamp time, const SE3& turn) const;
  /// Whether the camera is farther from where it was predicted to be at `time` than a hand can have moved it
  /// since the last pose. `near_depth` [map unit] of what is nearest of what it looks at.
  [[nodiscard]] bool is_leap(const SE3& camera_from_map, const SE3& predicted, Timestamp time,
                             double near_depth) const;
  /// A measured pose: velocity becomes 0.9 * (half of the newest step's + half of the old one).
  void measured(const SE3& camera_from_map, Timestamp time);
  /// A frame without a measurement: the velocity decays, and the camera turned by `turn` since the frame
  /// before, as the small images say.
  void missed(const SE3& turn);
  /// Starts from a pose at rest.
  void reset(const SE3& camera_from_map, Timestamp time);
  /// Moves the remembered pose with its map after an adjustment; the velocity, in camera coordinates, is
  /// unaffected.
  void rebase(const SE3& camera_from_map) { last_ = camera_from_map; }

  [[nodiscard]] const SE3& last() const { return last_; }
  /// Tangent per second, camera frame: (m/s, rad/s).
  [[nodiscard]] const Vector6d& velocity() const { return velocity_; }

 private:
  SE3 last_;
  Timestamp time_;
  Vector6d velocity_ = Vector6d::Zero();
};

/// Corrects a predicted camera step by what the tiny images saw: keeps its translation and adds the rotation
/// that makes two points at `mean_depth`, +-5 tiny px from the image centre, move as `seen` says. Image
/// motion that the translation explains already is not counted twice (PTAM drops the translation instead;
/// PTAM r114).
[[nodiscard]] SE3 correct_step(const SE3& predicted_step, const TinyMotion& seen, const Camera& camera,
                               double mean_depth);

/// Corrects a camera step whose turn is known by what the tiny images saw: adds the translation across the
/// view that makes a point at `mean_depth` in the middle move as `seen` says.
[[nodiscard]] SE3 correct_translation(const SE3& step, const TinyMotion& seen, const Camera& camera,
                                      double mean_depth);

}  // namespace cairn
