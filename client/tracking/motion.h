// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/tiny_image.h"

namespace cairn {

struct MotionOptions {
  double decay = 0.9;         ///< of the velocity, per frame (PTAM r114)
  double longest_step = 0.2;  ///< [s] a velocity is not believed for longer
  /// [near depths / s^2] Beyond, a step is a leap: 3 g half a metre away. Found with mean depths, of scenes
  /// where these hardly differ. Of poor frames in hand-held recordings at 30 Hz the most is 21, with the hand
  /// six times as fast a twentieth has more than 42; of those before a loss 85 to 800.
  double most_acceleration = 60;
  /// [s] A step counts as at least so long where a leap is judged: in less, the noise of poses counts,
  /// whatever the frame rate.
  double shortest_step = 1.0 / 30;
};

/// How a step of the camera is corrected by what the small images saw (correct_step).
struct StepCorrectionOptions {
  float offset = 5.0F;  ///< [tiny px] of the two points from the centre (PTAM r114)
  int iterations = 3;   ///< of Gauss-Newton
  double prior = 10.0;  ///< [px^2 / rad^2] information of no correction (PTAM r114)
};

/// Decaying constant velocity in real time stamps (PTAM's counts frames and so breaks when frames are
/// dropped; PTAM r114).
class MotionModel {
 public:
  explicit MotionModel(const MotionOptions& options) : options_(options) {}

  /// Camera motion from the last pose to `time`, by the velocity.
  [[nodiscard]] SE3 predicted_step(Timestamp time) const;
  /// The same with the camera's turn (now from before) known and not predicted.
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
  /// Tangent per second, camera frame: (map unit/s, rad/s).
  [[nodiscard]] const Vector6d& velocity() const { return velocity_; }

 private:
  [[nodiscard]] Vector6d step_to(Timestamp time) const;

  MotionOptions options_;
  SE3 last_;
  Timestamp time_;
  Vector6d velocity_ = Vector6d::Zero();
};

/// Corrects a predicted camera step by what the tiny images saw: keeps its translation and adds the rotation
/// that makes two points at `mean_depth`, +-5 tiny px from the image centre, move as `seen` says. Image
/// motion that the translation explains already is not counted twice (PTAM drops the translation instead;
/// PTAM r114).
[[nodiscard]] SE3 correct_step(const SE3& predicted_step, const TinyMotion& seen, const Camera& camera,
                               double mean_depth, const StepCorrectionOptions& options);

/// Corrects a camera step whose turn is known by what the tiny images saw: adds the translation across the
/// view that makes a point at `mean_depth` in the middle move as `seen` says.
[[nodiscard]] SE3 correct_translation(const SE3& step, const TinyMotion& seen, const Camera& camera,
                                      double mean_depth);

}  // namespace cairn
