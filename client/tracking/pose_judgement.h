// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "common/geometry/se3.h"

namespace cairn {

/// The part of a pose that a frame determines.
enum class PoseSupport : uint8_t {
  kNone,
  kRotation,  ///< and not the position, which is where it was believed to be
  kPosition,  ///< all of it
};

struct PoseJudgementOptions {
  /// Greatest sigma of a position that counts as known, over the depth: an overlay stands still.
  double known_position = 0.01;
  /// [rad] Greatest sigma of a rotation that counts as known, for pixels of the level with a sigma of one.
  /// Patches are aligned to 0.3, so it is then known to half a degree.
  double known_rotation = 0.033;
};

/// How well a pose is determined, and what follows from it.
struct PoseJudgement {
  PoseSupport support = PoseSupport::kNone;
  double position_sigma = 0;  ///< in the direction known worst, over the mean depth
  double rotation_sigma = 0;  ///< of the axis known worst [rad], if the position were known
};
/// Judges a pose by the information that the observations of a frame have of (translation, rotation), left
/// tangent. `mean_depth` [map unit] of what the camera looks at.
[[nodiscard]] PoseJudgement judge_pose(const Matrix6d& information, double mean_depth,
                                       const PoseJudgementOptions& options);

}  // namespace cairn
