// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/evidence.h"

#include <algorithm>
#include <variant>

#include "client/tracking/tracker_options.h"

namespace cairn {
namespace {

/// The least that a pose must show.
struct Demand {
  int found = 0;
  float quality = 0;
  bool suffices = false;  ///< who meets it is not bad, whatever the share says
};

/// The share of points that a pose must show after a frame that showed `quality`, at a place where the camera
/// can have got to since.
float kept_quality(float quality, const TrackerOptions& options) {
  return std::clamp(options.evidence.quality_kept * quality, options.lost_quality,
                    options.recovery.verified_quality);
}

Demand demand_while_tracking(const Tracking& tracking, PoseOrigin origin, const TrackerOptions& options) {
  const float kept = kept_quality(tracking.quality, options);
  switch (origin) {
    case PoseOrigin::kFlow:
      return {options.evidence.enough_points, options.evidence.flow_quality, true};
    case PoseOrigin::kCorners:
      return {options.recovery.fewest_points, kept, true};
    case PoseOrigin::kMotion:
      break;
  }
  // After a frame that failed the prediction is a guess: what has left the image is found again centimetres
  // off, on its last points.
  if (tracking.failed_frames > 0) return {options.recovery.fewest_points, kept};
  return {};
}

Demand demand_of(PoseOrigin origin, const RecoveryState& state, const TrackerOptions& options) {
  if (const auto* verifying = std::get_if<Verifying>(&state))
    return {options.recovery.fewest_points, verifying->needed_quality};
  if (const auto* tracking = std::get_if<Tracking>(&state))
    return demand_while_tracking(*tracking, origin, options);
  if (const auto* turned = std::get_if<Turned>(&state))
    return {options.recovery.fewest_points, kept_quality(turned->quality, options)};
  return {options.recovery.fewest_points, options.recovery.verified_quality};
}

/// Whether a poor frame may be believed. A frame that shows something else than the one before is none to be
/// half found. A map that leaves the image is tracked on its last points, all of them to one side, and with
/// these the pose runs away before it is lost: so a leap needs many points.
bool is_poor_for_a_reason(const FrameEvidence& evidence, const EvidenceOptions& options) {
  return !evidence.is_cut && !(evidence.is_leap && evidence.found < options.enough_points);
}

}  // namespace

PoseVerdict judge_frame(const FrameEvidence& evidence, PoseOrigin origin, const RecoveryState& state,
                        const TrackerOptions& options) {
  const Demand demand = demand_of(origin, state, options);
  if (!evidence.has_pose || evidence.found < demand.found || evidence.quality < demand.quality)
    return PoseVerdict::kBad;
  if (demand.suffices) return std::min(evidence.share, PoseVerdict::kPoor);
  if (evidence.share == PoseVerdict::kPoor && !is_poor_for_a_reason(evidence, options.evidence))
    return PoseVerdict::kBad;
  return evidence.share;
}

bool is_sound(const FrameEvidence& evidence, PoseVerdict verdict, const TrackerOptions& options) {
  return verdict == PoseVerdict::kGood ||
         (evidence.found >= options.evidence.enough_points && evidence.quality > options.lost_quality);
}

}  // namespace cairn
