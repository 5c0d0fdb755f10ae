// SPDX-License-Identifier: Apache-2.0
//
// The search for the camera in a frame (PTAM, section 5.6; relocalization: PTAMM, section 4), and what holds
// on where it finds nothing.
#include <fmt/format.h>

#include <span>
#include <utility>

#include "client/tracking/tracker_state.h"

namespace cairn {

/// Searches from where the motion expects the camera. Where it is not found, searches by what else tells
/// where it is, in order of cost.
void Tracker::State::track(Timestamp time) {
  Attempt found = search_by_motion(time);
  const bool is_verified = recovery.as<Verifying>() != nullptr;
  if (found.verdict == PoseVerdict::kBad && !is_verified) found = search_otherwise();
  if (found.verdict != PoseVerdict::kBad) {
    accept(found, time);
    return;
  }
  if (!is_verified && hold(time)) {
    if (!result.pose_measured) look_for_camera(time);
    return;
  }
  miss(time, fmt::format("{} of {} points found", finder.found(), finder.attempted()));
  if (!is_verified) look_for_camera(time);
}

Tracker::State::Attempt Tracker::State::attempt(const SE3& from, const SearchEffort& effort) {
  Attempt found;
  found.pose = finder.locate(now(), from, effort, probe);
  if (!found.pose) return found;
  found.evidence = {true, finder.judge(), finder.found(), finder.quality(), false, is_cut};
  return found;
}

Tracker::State::Attempt Tracker::State::judged(Attempt found, PoseOrigin origin) const {
  found.verdict = judge_frame(found.evidence, origin, recovery.state(), options);
  return found;
}

SearchEffort Tracker::State::expected_effort() const {
  SearchEffort effort = normal_effort(options);
  if (const auto* tracking = recovery.as<Tracking>()) {
    if (tracking->failed_frames == 0) effort.expected_quality = tracking->quality;
  } else if (const auto* verifying = recovery.as<Verifying>()) {
    effort.expected_quality = verifying->quality;
    effort.enough_aligned = 1;  // everything that speaks for it or against it
  }
  return effort;
}

/// Searches from where the velocity and the small image expect the camera (at a cut the velocity and the
/// gyro). Where it is not found, it is sought twice as far about where the small image alone expects it; then
/// turned as the gyro says, and moved so that the small image agrees.
Tracker::State::Attempt Tracker::State::search_by_motion(Timestamp time) {
  const SE3 by_images =
      correct_step(model.predicted_step(time), seen, *camera, mean_depth, options.step_correction);
  const SE3 by_gyro = gyro.turn() ? model.predicted_step(time, *gyro.turn()) : by_images;
  const SE3 expected = (is_cut ? by_gyro : by_images) * model.last();
  Attempt found = attempt(expected, expected_effort());
  in_sight = finder.attempted();
  if (found.evidence.share == PoseVerdict::kBad)
    found = attempt(turned() * model.last(), wide_effort(options));
  if (found.evidence.share == PoseVerdict::kBad && gyro.turn() && !is_cut)
    found =
        attempt(correct_translation(by_gyro, seen, *camera, mean_depth) * model.last(), wide_effort(options));
  // Who comes back expects the camera degrees away from where it is: what is in sight, and how it looks, is
  // judged anew from the pose found.
  if (found.pose && recovery.as<Turned>() != nullptr) found = attempt(*found.pose, normal_effort(options));
  if (found.pose) found.evidence.is_leap = model.is_leap(*found.pose, expected, time, near_depth);
  found = judged(found, PoseOrigin::kMotion);
  const bool is_doubted =
      found.verdict != PoseVerdict::kBad && found.pose && !recovery.is_reachable(*found.pose);
  return is_doubted ? compared_within_reach(found) : found;
}

/// Compares a pose out of reach with the one found where the camera can be, and prefers that if it shows
/// there: a structure that repeats draws a search to another of its periods.
Tracker::State::Attempt Tracker::State::compared_within_reach(Attempt found) {
  const SE3 there = *found.pose;
  const Attempt near =
      judged(attempt(recovery.within_reach(there), normal_effort(options)), PoseOrigin::kMotion);
  if (near.verdict != PoseVerdict::kBad && near.pose && recovery.is_reachable(*near.pose)) return near;
  const bool is_leap = found.evidence.is_leap;
  found = attempt(there, normal_effort(options));
  found.evidence.is_leap = is_leap;
  return judged(found, PoseOrigin::kMotion);
}

Tracker::State::Attempt Tracker::State::search_otherwise() {
  if (const auto from = flow.pose(previous(), now(), seen, *map)) {
    const Attempt found = judged(attempt(*from, normal_effort(options)), PoseOrigin::kFlow);
    if (found.verdict != PoseVerdict::kBad) return found;
  }
  if (const auto from = recovery.by_corners(now(), *map, model.last(), mean_depth)) {
    const Attempt found = attempt(*from, normal_effort(options));
    if (found.pose && recovery.is_reachable(*found.pose)) return judged(found, PoseOrigin::kCorners);
  }
  return {};
}

SearchEffort Tracker::State::effort_of(PoseStart::Reach reach) const {
  if (reach == PoseStart::Reach::kNear) return normal_effort(options);
  SearchEffort effort = wide_effort(options);
  effort.needs_coarse = reach == PoseStart::Reach::kQuick;
  return effort;
}

/// Searches from one place after another where the camera may be. Where it is found it is followed, and
/// published once it has held.
void Tracker::State::look_for_camera(Timestamp time) {
  while (const auto start = recovery.next_start(now(), *map, model.last(), mean_depth, time)) {
    Attempt found = attempt(start->camera_from_map, effort_of(start->reach));
    if (!found.pose) continue;
    const auto believed =
        recovery.believe(*start, {*found.pose, found.evidence.found, found.evidence.quality}, time);
    if (!believed) continue;
    found.verdict = PoseVerdict::kGood;
    recovery.begin_verifying(*believed, time);
    model.reset(*found.pose, time);
    accept(found, time);
    return;
  }
}

/// The camera was not found; it is expected where it has turned to.
void Tracker::State::miss(Timestamp time, std::string why) {
  model.missed(recovery.is_lost() && gyro.is_by_gyro() ? *gyro.turn() : turned());
  flow.missed();
  recovery.lose_sight(previous());
  recovery.fail(is_cut, time);
  result.state = TrackingState::kLost;
  result.note = std::move(why);
}

/// The camera has turned away from what the map shows: what it followed until then says where to. That is no
/// measurement by the map, and who is held is not lost.
bool Tracker::State::hold(Timestamp time) {
  const bool was_tracked = recovery.as<Tracking>() != nullptr || recovery.as<Turned>() != nullptr;
  if (!was_tracked || reckoning.is_over()) return false;
  const SE3 expected = turned() * model.last();
  // What a search found somewhere else does not show where the camera is.
  const bool is_here = finder.located() && !model.is_leap(*finder.located(), expected, time, near_depth);
  const auto reckoned = reckoning.by_corners(
      now(), expected, is_here ? std::span(finder.points()) : std::span<const VisiblePoint>{},
      {mean_depth, near_depth}, *map);
  if (!reckoned) return hold_blindly();
  if (!is_here) finder.clear();
  gyro.seen();
  measured(reckoned->camera_from_map, time);
  claim_held(reckoned->is_position_known);
  if (result.pose_measured && local.is_overdue()) propose_keyframe(time);
  return true;
}

/// Smeared by a quick turn, or blank, the frame shows nothing that could be followed; how far it turned, the
/// gyro says, or else the small images.
bool Tracker::State::hold_blindly() {
  const bool is_carried = in_sight < options.keyframes.scarce_points &&
                          gyro.carries(options.finder.coarse_radius / camera->focal_length());
  const SE3 expected = (is_carried ? *gyro.turn() : turned()) * model.last();
  if (is_carried) {
    reckoning.follow_turn(now(), expected, gyro.blind_sigma(), mean_depth, *map);
  } else if (!reckoning.follow_small_images(now(), expected, likeness, mean_depth, *map)) {
    return false;
  }
  finder.clear();  // what it found last is no part of this pose
  model.missed(is_carried ? *gyro.turn() : turned());
  claim_held(false);
  return true;
}

void Tracker::State::claim_held(bool is_position_known) {
  flow.missed();
  if (!is_position_known) recovery.turn_away();
  result.state = is_position_known ? TrackingState::kPoor : TrackingState::kRotation;
  result.pose_measured = is_position_known;
  result.mean_depth = mean_depth;
  result.note = is_position_known ? "" : "turned away from what the map shows";
}

}  // namespace cairn
