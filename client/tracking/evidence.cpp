// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/evidence.h"

#include <algorithm>
#include <variant>

namespace cairn {
namespace {

// A place where the camera can have got to since it was tracked needs this share of the quality it had.
constexpr float kQualityKept = 0.7F;
// Points followed from the frame before may agree of a map that has most of its points elsewhere.
constexpr float kFlowQuality = 0.1F;

/// What a pose must show.
struct Demand {
  int found = 0;
  float quality = 0;
  bool suffices = false;  ///< who meets it is not bad, whatever the share says
};

/// Of a place where the camera can have got to.
float kept_quality(float quality, const TrackerOptions& options) {
  return std::clamp(kQualityKept * quality, options.lost_quality, Recovery::kVerifiedQuality);
}

Demand demand_while_tracking(const Tracking& tracking, PoseOrigin origin, const TrackerOptions& options) {
  const float kept = kept_quality(tracking.quality, options);
  switch (origin) {
    case PoseOrigin::kFlow:
      return {kEnoughPoints, kFlowQuality, true};
    case PoseOrigin::kCorners:
      return {Recovery::kFewestPoints, kept, true};
    case PoseOrigin::kMotion:
      break;
  }
  // After a frame that failed the prediction is a guess: what has left the image is found again centimetres
  // off, on its last points.
  if (tracking.failed_frames > 0) return {Recovery::kFewestPoints, kept};
  return {};
}

Demand demand_of(PoseOrigin origin, const RecoveryState& state, const TrackerOptions& options) {
  if (const auto* verifying = std::get_if<Verifying>(&state))
    return {Recovery::kFewestPoints, verifying->needed_quality};
  if (const auto* tracking = std::get_if<Tracking>(&state))
    return demand_while_tracking(*tracking, origin, options);
  if (const auto* turned = std::get_if<Turned>(&state))
    return {Recovery::kFewestPoints, kept_quality(turned->quality, options)};
  return {Recovery::kFewestPoints, Recovery::kVerifiedQuality};
}

/// What leaves the image is tracked on its last points, all of them to one side, and with these the pose
/// runs away before it is lost. A frame that shows something else than the one before is none to be half
/// found.
bool is_poor_for_a_reason(const FrameEvidence& evidence) {
  return !evidence.is_cut && !(evidence.is_leap && evidence.found < kEnoughPoints);
}

}  // namespace

PoseVerdict judge_frame(const FrameEvidence& evidence, PoseOrigin origin, const RecoveryState& state,
                        const TrackerOptions& options) {
  const Demand demand = demand_of(origin, state, options);
  if (!evidence.has_pose || evidence.found < demand.found || evidence.quality < demand.quality)
    return PoseVerdict::kBad;
  if (demand.suffices) return std::min(evidence.share, PoseVerdict::kPoor);
  if (evidence.share == PoseVerdict::kPoor && !is_poor_for_a_reason(evidence)) return PoseVerdict::kBad;
  return evidence.share;
}

bool is_sound(const FrameEvidence& evidence, PoseVerdict verdict, const TrackerOptions& options) {
  return verdict == PoseVerdict::kGood ||
         (evidence.found >= kEnoughPoints && evidence.quality > options.lost_quality);
}

}  // namespace cairn
