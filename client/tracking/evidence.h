// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "client/relocalization/recovery.h"
#include "client/tracking/pose_finder.h"

namespace cairn {

struct TrackerOptions;

struct EvidenceOptions {
  /// Share of the quality of the latest frame that showed the map, which a pose must show where the camera
  /// can have got to since.
  float quality_kept = 0.7F;
  /// Share found: points followed from the frame before may agree of a map that has most of its points
  /// elsewhere.
  float flow_quality = 0.1F;
  int enough_points = 50;  ///< found, with which a pose is sound although most of the map is out of sight
};

/// The source of the pose from which a frame is searched.
enum class PoseOrigin : uint8_t {
  kMotion,   ///< velocity and the small image
  kFlow,     ///< points of the frame before, followed: these know no look-alikes
  kCorners,  ///< corners recognized around the last pose
};

/// The result of a search of a frame, as far as it tells whether to believe the pose.
struct FrameEvidence {
  bool has_pose = false;
  PoseVerdict share = PoseVerdict::kBad;  ///< by the share found alone (PoseFinder::judge)
  int found = 0;                          ///< points, inliers of the pose
  float quality = 0;                      ///< share found of those in sight
  bool is_leap = false;  ///< the pose is farther from where it was expected than a hand moves a camera
  bool is_cut = false;   ///< the frame has nothing in common with the one before
};

/// How far the pose is to be believed, by all that is known of the frame and of those before it. Pure.
[[nodiscard]] PoseVerdict judge_frame(const FrameEvidence& evidence, PoseOrigin origin,
                                      const RecoveryState& state, const TrackerOptions& options);

/// Whether the pose is good enough to be built upon. Many points are enough where most of the map is out of
/// sight; but some are found in a place that looks like this one, too, so more than `lost_quality` of those
/// in sight must be.
[[nodiscard]] bool is_sound(const FrameEvidence& evidence, PoseVerdict verdict,
                            const TrackerOptions& options);

}  // namespace cairn
