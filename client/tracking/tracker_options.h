// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "client/relocalization/recovery.h"
#include "client/tracking/dead_reckoning.h"
#include "client/tracking/evidence.h"
#include "client/tracking/exposure.h"
#include "client/tracking/flow_prior.h"
#include "client/tracking/gyro_prior.h"
#include "client/tracking/keyframe_policy.h"
#include "client/tracking/local_map.h"
#include "client/tracking/motion.h"
#include "client/tracking/pose_finder.h"
#include "client/tracking/pose_judgement.h"
#include "client/tracking/provisional_points.h"
#include "client/tracking/still_regions.h"
#include "client/tracking/trail_pose.h"
#include "client/tracking/trails.h"
#include "common/base/option_list.h"

namespace cairn {

/// Options of a tracker, those of its parts included.
struct TrackerOptions {
  bool make_maps = true;       ///< seeds are proposed while there is no map
  bool make_keyframes = true;  ///< keyframes are proposed
  uint64_t seed = 1;           ///< of all random choices
  float good_quality = 0.3F;   ///< share found of those in sight; below, a frame is poor (PTAM r114)
  float lost_quality = 0.13F;  ///< of points on the top two levels; below: a bad frame (PTAM r114)
  /// Correlation of the tiny images of two frames, the motion between them undone: below, they show different
  /// things, most likely; strangers are above now and then, and cost two frames more.
  float same_view = 0.5F;

  PoseFinderOptions finder;
  EvidenceOptions evidence;
  MotionOptions motion;
  GyroPriorOptions gyro;
  StepCorrectionOptions step_correction;
  FlowPriorOptions flow;
  ExposureOptions exposure;
  KeyframePolicyOptions keyframes;
  TrailOptions trails;
  TrailPoseOptions trail_pose;
  PoseJudgementOptions judgement;
  ProvisionalPointsOptions provisional;
  DeadReckoningOptions reckoning;
  LocalMapOptions local;
  StillRegionsOptions still;
  RecoveryOptions recovery;  ///< its seed and least quality are those above
};

/// Lists all options that are no choice of a run; make_maps, make_keyframes and seed are such choices.
[[nodiscard]] OptionList list_options(TrackerOptions* options);

}  // namespace cairn
