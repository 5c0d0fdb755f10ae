// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker_options.h"

#include <numbers>

#include "common/base/member_count.h"
#include "common/image/pyramid.h"

namespace cairn {
namespace {

// Ranges are what the code stands, not what is sensible.
constexpr OptionList::Range kShare = {0, 1};
constexpr OptionList::Range kLevel = {0, kPyramidLevels - 1};
constexpr OptionList::Range kRadius = {0, 1000};
constexpr OptionList::Range kIterations = {1, 1000};
constexpr OptionList::Range kPoints = {0, 1e6};
constexpr OptionList::Range kFrames = {0, 1e6};
constexpr OptionList::Range kSeconds = {0, 3600};
constexpr OptionList::Range kSquaredCutoff = {1e-6, 1e6};
constexpr OptionList::Range kGreyLevels = {0, 255};
constexpr OptionList::Range kOverDepth = {0, 1000};
constexpr OptionList::Range kAngle = {0, std::numbers::pi};
constexpr OptionList::Range kTexture = {0, 1e6};
constexpr OptionList::Range kMilliseconds = {0, 3.6e6};

OptionList list_options(KeptTemplateOptions* o) {
  OptionList list(member_count<KeptTemplateOptions>());
  list.add("template_change", &o->template_change, {0, 10}, "search-level px per source px");
  list.add("smear_change", &o->smear_change, kShare, "of the smear's length");
  list.add("least_smear", &o->least_smear, kRadius, "search-level px");
  list.add("coarse_level", &o->coarse_level, kLevel, "level");
  return list;
}

OptionList list_options(FrustumOptions* o) {
  OptionList list(member_count<FrustumOptions>() - 1);  // `nearest` is the point search's
  list.add("rays_per_axis", &o->rays_per_axis, {2, 1000}, "rays");
  list.add("side_margin", &o->side_margin, kShare, "rad");
  list.add("coarse_area", &o->coarse_area, {1, 1000}, "level-0 px^2 per source px^2");
  list.add("min_depth_share", &o->min_depth_share, kShare, "of the distance");
  list.add("extra_angle", &o->extra_angle, kAngle, "rad");
  list.add("nearer", &o->nearer, kShare, "of the nearest keyframe's distance");
  list.add("farther", &o->farther, {1, 1e6}, "of the farthest keyframe's distance");
  return list;
}

OptionList list_options(PointSearchOptions* o) {
  OptionList list(member_count<PointSearchOptions>());
  list.add("nearest", &o->nearest, {1e-9, 1e3}, "map unit");
  list.add("alignment_reach", &o->alignment_reach, kRadius, "search-level px");
  list.add("least_radius", &o->least_radius, kRadius, "search-level px");
  list.add_part("templates", list_options(&o->templates));
  list.add_part("frustum", list_options(&o->frustum));
  return list;
}

OptionList list_options(PoseFinderOptions* o) {
  OptionList list(member_count<PoseFinderOptions>());
  list.add("max_points", &o->max_points, {1, 1e6}, "points");
  list.add("coarse_points", &o->coarse_points, kPoints, "points");
  list.add("coarse_radius", &o->coarse_radius, kRadius, "px of level 0");
  list.add("fine_radius", &o->fine_radius, kRadius, "px of level 0");
  list.add("fine_radius_after_coarse", &o->fine_radius_after_coarse, kRadius, "px of level 0");
  list.add("coarse_level", &o->coarse_level, kLevel, "level");
  list.add("coarse_available", &o->coarse_available, kPoints, "points");
  list.add("coarse_found", &o->coarse_found, {3, 1e6}, "points");
  list.add("enough_aligned", &o->enough_aligned, kShare, "of the points searched");
  list.add("refine_iterations", &o->refine_iterations, kIterations);
  list.add("large_attempted", &o->large_attempted, kPoints, "points");
  list.add("fewest_found", &o->fewest_found, {3, 1e6}, "points");
  list.add("least_quality", &o->least_quality, kShare, "of the points in sight");
  list.add("min_squared_cutoff", &o->min_squared_cutoff, kSquaredCutoff, "sigma^2");
  list.add("max_squared_cutoff", &o->max_squared_cutoff, kSquaredCutoff, "sigma^2");
  list.add_order("min_squared_cutoff", "max_squared_cutoff");
  list.add("most_rms", &o->most_rms, {0, 1e6}, "sigma");
  list.add("least_of_quality_expected", &o->least_of_quality_expected, kShare, "of the quality before");
  list.add("widen", &o->widen, {1, 100});
  list.add("behind", &o->behind, {1, 1000}, "of the depth beside it");
  list.add_part("points", list_options(&o->points));
  return list;
}

OptionList list_options(EvidenceOptions* o) {
  OptionList list(member_count<EvidenceOptions>());
  list.add("quality_kept", &o->quality_kept, kShare, "of the quality it had");
  list.add("flow_quality", &o->flow_quality, kShare, "of the points in sight");
  list.add("enough_points", &o->enough_points, kPoints, "points");
  return list;
}

OptionList list_options(MotionOptions* o) {
  OptionList list(member_count<MotionOptions>());
  list.add("decay", &o->decay, kShare, "per frame");
  list.add("longest_step", &o->longest_step, kSeconds, "s");
  list.add("most_acceleration", &o->most_acceleration, {0, 1e6}, "near depths / s^2");
  list.add("shortest_step", &o->shortest_step, kSeconds, "s");
  return list;
}

OptionList list_options(GyroBiasOptions* o) {
  OptionList list(member_count<GyroBiasOptions>());
  list.add("first_sigma", &o->first_sigma, {1e-9, 10}, "rad/s");
  list.add("image_sigma", &o->image_sigma, {1e-9, 1}, "rad");
  list.add("drift", &o->drift, {0, 1}, "rad/s per sqrt(s)");
  list.add("gate", &o->gate, {0, 1000}, "sigma");
  list.add("forget", &o->forget, kShare, "per frame");
  list.add("unexplained", &o->unexplained, kShare, "of the turns");
  list.add("no_turn", &o->no_turn, {0, 1000}, "image_sigma");
  return list;
}

OptionList list_options(UpFilterOptions* o) {
  OptionList list(member_count<UpFilterOptions>());
  list.add("late", &o->late, {1e-3, 3600}, "s");
  list.add("accelerometer_sigma", &o->accelerometer_sigma, {1e-6, 1}, "g");
  list.add("shaken_for", &o->shaken_for, kSeconds, "s");
  list.add("most_sigma", &o->most_sigma, kAngle, "rad");
  return list;
}

OptionList list_options(InertialSensorOptions* o) {
  OptionList list(member_count<InertialSensorOptions>());
  list.add("most_gap", &o->most_gap, kSeconds, "s");
  list.add("most_ahead", &o->most_ahead, kSeconds, "s");
  list.add("kept", &o->kept, kSeconds, "s");
  list.add("jump", &o->jump, kSeconds, "s");
  list.add("noise", &o->noise, {0, 1}, "rad per sqrt(s)");
  list.add("turn_acceleration", &o->turn_acceleration, {0, 1e6}, "rad/s^2");
  list.add("turn_jerk", &o->turn_jerk, {0, 1e9}, "rad/s^3");
  list.add_part("bias", list_options(&o->bias));
  list.add_part("up", list_options(&o->up));
  return list;
}

OptionList list_options(EncoderTurnOptions* o) {
  OptionList list(member_count<EncoderTurnOptions>());
  list.add("most_gap", &o->most_gap, kSeconds, "s");
  list.add("most_ahead", &o->most_ahead, kSeconds, "s");
  list.add("kept", &o->kept, {2, 1e6}, "samples");
  return list;
}

OptionList list_options(GyroPriorOptions* o) {
  OptionList list(member_count<GyroPriorOptions>());
  list.add("sigmas", &o->sigmas, {0, 100}, "sigma");
  list.add_part("sensor", list_options(&o->sensor));
  list.add_part("encoders", list_options(&o->encoders));
  return list;
}

OptionList list_options(StepCorrectionOptions* o) {
  OptionList list(member_count<StepCorrectionOptions>());
  list.add("offset", &o->offset, {0.1, 1000}, "tiny px");
  list.add("iterations", &o->iterations, kIterations);
  list.add("prior", &o->prior, {0, 1e9}, "px^2 / rad^2");
  return list;
}

OptionList list_options(PatchFlowOptions* o) {
  OptionList list(member_count<PatchFlowOptions>());
  list.add("coarsest_level", &o->coarsest_level, kLevel, "level");
  list.add("required_level", &o->required_level, kLevel, "level");
  list.add_order("required_level", "coarsest_level");
  list.add("search_radius", &o->search_radius, kRadius, "px of level 0");
  list.add("way_back_error", &o->way_back_error, kRadius, "level px");
  list.add("iterations", &o->iterations, kIterations);
  return list;
}

OptionList list_options(FlowPriorOptions* o) {
  OptionList list(member_count<FlowPriorOptions>());
  list.add("most_followed", &o->most_followed, {1, 1e6}, "points");
  list.add("fewest_followed", &o->fewest_followed, {4, 1e6}, "points");
  list.add_part("patches", list_options(&o->patches));
  return list;
}

OptionList list_options(ExposureOptions* o) {
  OptionList list(member_count<ExposureOptions>());
  list.add("step", &o->step, {1e-6, 1}, "s");
  list.add("longest", &o->longest, {0, 10}, "s");
  list.add("kept", &o->kept, kShare, "per frame");
  list.add("least_smear", &o->least_smear, kRadius, "search-level px");
  list.add("most_asked", &o->most_asked, {1, 1e6}, "points");
  list.add("most_telling", &o->most_telling, {1, 1e6}, "points");
  return list;
}

OptionList list_options(KeyframePolicyOptions* o) {
  OptionList list(member_count<KeyframePolicyOptions>());
  list.add("frames_between", &o->frames_between, kFrames, "frames");
  list.add("shortest_wait", &o->shortest_wait, kShare, "of frames_between");
  list.add("distance", &o->distance, kOverDepth, "mean depths");
  list.add("running_out", &o->running_out, kShare, "of the points found at best");
  list.add("few_left", &o->few_left, kShare, "of the points found at best");
  list.add("scarce_points", &o->scarce_points, kPoints, "points");
  list.add("need_distance", &o->need_distance, kShare, "of distance");
  list.add("area_level", &o->area_level, kLevel, "level");
  list.add("area_barrier", &o->area_barrier, kGreyLevels, "grey levels");
  list.add("area_texture", &o->area_texture, kTexture, "Shi-Tomasi's measure");
  return list;
}

OptionList list_options(TrailOptions* o) {
  OptionList list(member_count<TrailOptions>());
  list.add("count", &o->count, {1, 1e6}, "trails");
  list.add("cell", &o->cell, {1, 1e4}, "px");
  list.add("barrier", &o->barrier, kGreyLevels, "grey levels");
  list.add("texture", &o->texture, kTexture, "Shi-Tomasi's measure");
  list.add("low_barrier", &o->low_barrier, kGreyLevels, "grey levels");
  list.add("low_texture", &o->low_texture, kTexture, "Shi-Tomasi's measure");
  list.add("fewest", &o->fewest, {1, 1e6}, "trails");
  list.add("fewest_share", &o->fewest_share, kShare, "of the trails begun");
  list.add("fewest_movement", &o->fewest_movement, kShare, "of the image width");
  list.add("more_movement", &o->more_movement, {1, 100});
  list.add("view_step", &o->view_step, {1e-3, 1000}, "px");
  list.add("most_views", &o->most_views, {2, 1e4}, "views");
  list.add("match_sigma", &o->match_sigma, {1e-3, 100}, "px");
  list.add("most_drift", &o->most_drift, kRadius, "px");
  list.add("match_iterations", &o->match_iterations, kIterations);
  list.add("most_remembered", &o->most_remembered, kPoints, "trails");
  list.add("most_judged", &o->most_judged, {1, 1e6}, "trails");
  list.add("fewest_judged", &o->fewest_judged, {5, 1e6}, "trails");
  list.add("max_depth_sigma", &o->max_depth_sigma, kOverDepth, "of the depth");
  list.add("max_direction_sigma", &o->max_direction_sigma, kAngle, "rad");
  list.add_part("patches", list_options(&o->patches));
  return list;
}

OptionList list_options(TrailPoseOptions* o) {
  OptionList list(member_count<TrailPoseOptions>());
  list.add("fewest", &o->fewest, {4, 1e6}, "trails");
  return list;
}

OptionList list_options(PoseJudgementOptions* o) {
  OptionList list(member_count<PoseJudgementOptions>());
  list.add("known_position", &o->known_position, kOverDepth, "mean depths");
  list.add("known_rotation", &o->known_rotation, kAngle, "rad");
  return list;
}

OptionList list_options(ProvisionalPointsOptions* o) {
  OptionList list(member_count<ProvisionalPointsOptions>());
  list.add("finest_level", &o->finest_level, kLevel, "level");
  list.add("coarsest_level", &o->coarsest_level, kLevel, "level");
  list.add_order("finest_level", "coarsest_level");
  list.add("cell_limit", &o->cell_limit, {0, 1000}, "points");
  list.add("begin_every", &o->begin_every, kFrames, "frames");
  list.add("neighbour", &o->neighbour, kRadius, "px of level 0");
  list.add("least_texture", &o->least_texture, kTexture, "Shi-Tomasi's measure");
  list.add("oldest", &o->oldest, kFrames, "frames");
  list.add("unseen_limit", &o->unseen_limit, kFrames, "frames");
  list.add("miss_limit", &o->miss_limit, kFrames, "frames");
  list.add("refusals", &o->refusals, {1, 1e6}, "frames");
  list.add("iterations", &o->iterations, kIterations);
  list.add("coarse_radius", &o->coarse_radius, kRadius, "px of level 0");
  list.add("fine_radius", &o->fine_radius, kRadius, "px of level 0");
  list.add("fewest_coarse", &o->fewest_coarse, {1, 1e6}, "points");
  list.add("fewest_bearings", &o->fewest_bearings, {3, 1e6}, "points");
  list.add("min_squared_cutoff", &o->min_squared_cutoff, kSquaredCutoff, "sigma^2");
  list.add("max_squared_cutoff", &o->max_squared_cutoff, kSquaredCutoff, "sigma^2");
  list.add_order("min_squared_cutoff", "max_squared_cutoff");
  list.add("measured_sigma", &o->measured_sigma, {1e-3, 100}, "search-level px");
  list.add("gate", &o->gate, {0, 1e6}, "chi-square of 2 degrees of freedom");
  list.add("news_distance", &o->news_distance, kOverDepth, "mean depths");
  list.add("free_position", &o->free_position, {1e-6, 1e6}, "mean depths");
  list.add("turned_only", &o->turned_only, {1e-9, 1e3}, "mean depths");
  list.add("point_depth", &o->point_depth, kOverDepth, "of the inverse depth");
  list.add("least_inverse", &o->least_inverse, {1e-12, 1}, "of 1 / mean depth");
  list.add("known_depth", &o->known_depth, kOverDepth, "of the depth");
  list.add_part("templates", list_options(&o->templates));
  return list;
}

OptionList list_options(DeadReckoningOptions* o) {
  OptionList list(member_count<DeadReckoningOptions>());
  list.add("rotation_held", &o->rotation_held, kFrames, "frames");
  list.add("position_held", &o->position_held, kFrames, "frames");
  list.add("blind", &o->blind, kFrames, "frames");
  list.add("blind_sigma", &o->blind_sigma, kAngle, "rad, and mean depths");
  list.add("same_turn", &o->same_turn, {-1, 1}, "correlation");
  return list;
}

OptionList list_options(LocalMapOptions* o) {
  OptionList list(member_count<LocalMapOptions>());
  list.add("answer_awaited", &o->answer_awaited, kMilliseconds, "ms");
  list.add("taken_over", &o->taken_over, kMilliseconds, "ms");
  list.add("overtaken", &o->overtaken, kMilliseconds, "ms");
  list.add("spacing", &o->spacing, kMilliseconds, "ms");
  list.add("same_scale", &o->same_scale, kShare, "of the extent");
  list.add("most_keyframes", &o->most_keyframes, {1, 1e5}, "keyframes");
  list.add("most_points", &o->most_points, {0, 1e6}, "points");
  list.add("most_measured", &o->most_measured, {1, 1e5}, "keyframes");
  list.add("moving", &o->moving, {1, 1e3}, "keyframes");
  list.add("least_parallax", &o->least_parallax, kAngle, "rad");
  list.add("adjustment_iterations", &o->adjustment_iterations, kIterations);
  list.add("fewest_fixed_points", &o->fewest_fixed_points, {3, 1e6}, "points");
  return list;
}

OptionList list_options(StillRegionsOptions* o) {
  OptionList list(member_count<StillRegionsOptions>());
  list.add("learn_every", &o->learn_every, {1, 1e6}, "frames");
  list.add("fast_threshold", &o->fast_threshold, {1, 254}, "grey levels");
  list.add("barrier", &o->barrier, kGreyLevels, "grey levels");
  list.add("texture", &o->texture, kTexture, "Shi-Tomasi's measure");
  list.add("square", &o->square, {1, 1e4}, "px of level 0");
  list.add("most_stay", &o->most_stay, kShare, "of a square's corners");
  list.add("fewest_moved", &o->fewest_moved, {0, 1e6}, "squares");
  list.add("moved_by_still", &o->moved_by_still, {0, 1e6}, "of the squares that stayed");
  // The frames in which a corner was seen are counted in a byte.
  list.add("fewest_counted", &o->fewest_counted, {1, 255}, "frames");
  list.add("most_counted", &o->most_counted, {1, 255}, "frames");
  list.add_order("fewest_counted", "most_counted");
  list.add("most_looks", &o->most_looks, kFrames, "frames");
  list.add("often_seen", &o->often_seen, kShare, "of the frames counted");
  list.add("most_change", &o->most_change, kGreyLevels, "grey levels of level 3");
  list.add("coherent", &o->coherent, kShare);
  list.add("rim_gradient", &o->rim_gradient, {0, 1000}, "grey levels of level 3 over two px");
  list.add("fewest_framed", &o->fewest_framed, {1, 1e6}, "cells");
  list.add("least_mean_change", &o->least_mean_change, kGreyLevels, "grey levels of level 3");
  list.add("most_watched", &o->most_watched, kGreyLevels, "grey levels");
  list.add("least_change", &o->least_change, kGreyLevels, "grey levels");
  return list;
}

OptionList list_options(RejectedHypothesesOptions* o) {
  OptionList list(member_count<RejectedHypothesesOptions>());
  list.add("enough", &o->enough, {1, 1e6}, "times");
  list.add("remembered", &o->remembered, kSeconds, "s");
  return list;
}

OptionList list_options(RelocQueryOptions* o) {
  OptionList list(member_count<RelocQueryOptions>());
  list.add("interval", &o->interval, kSeconds, "s");
  list.add("patience", &o->patience, kSeconds, "s");
  list.add("fresh", &o->fresh, kSeconds, "s");
  list.add("much_to_see", &o->much_to_see, kPoints, "corners");
  list.add_part("rejected", list_options(&o->rejected));
  return list;
}

OptionList list_options(PlaceMemoryOptions* o) {
  OptionList list(member_count<PlaceMemoryOptions>());
  list.add("most_views", &o->most_views, {1, 1e6}, "views");
  list.add("view_distance", &o->view_distance, kOverDepth, "mean depths");
  list.add("view_angle", &o->view_angle, kAngle, "rad");
  return list;
}

OptionList list_options(DescribedViewsOptions* o) {
  OptionList list(member_count<DescribedViewsOptions>());
  list.add("most_views", &o->most_views, {1, 1e6}, "views");
  list.add("most_points", &o->most_points, {1, 1e6}, "points");
  list.add("view_distance", &o->view_distance, kOverDepth, "mean depths");
  list.add("view_angle", &o->view_angle, kAngle, "rad");
  list.add("views_tried", &o->views_tried, {0, 1e6}, "views");
  list.add("most_distance", &o->most_distance, {0, 256}, "bits of 256");
  list.add("most_ratio", &o->most_ratio, kShare, "of the distance of the second nearest");
  list.add("fewest_inliers", &o->fewest_inliers, {4, 1e6}, "points");
  return list;
}

OptionList list_options(KeyframeRoundsOptions* o) {
  OptionList list(member_count<KeyframeRoundsOptions>());
  list.add("per_frame", &o->per_frame, {0, 1e6}, "keyframes");
  list.add("look_aside", &o->look_aside, kAngle, "rad");
  return list;
}

OptionList list_options(VerifiedPathOptions* o) {
  OptionList list(member_count<VerifiedPathOptions>());
  // What the poses that are kept hold, at the spacing that is usual.
  list.add("window", &o->window, {0, kMostVerifiedPoses * VerifiedPathOptions().spacing}, "s");
  list.add("lag", &o->lag, {1e-3, 3600}, "s");
  list.add("shortest", &o->shortest, kSeconds, "s");
  list.add("spacing", &o->spacing, {1e-3, 10}, "s");
  list.add_order("spacing", "shortest");
  list.add("sigmas", &o->sigmas, {0, 1000}, "sigma");
  return list;
}

OptionList list_options(RecoveryOptions* o) {
  OptionList list(member_count<RecoveryOptions>() - 2);  // seed and least quality are the tracker's
  list.add("lost_after_failed_frames", &o->lost_after_failed_frames, {1, 1e6}, "frames");
  list.add("fewest_points", &o->fewest_points, {3, 1e6}, "points");
  list.add("verified_quality", &o->verified_quality, kShare, "of the points in sight");
  list.add("hypothesis_quality", &o->hypothesis_quality, kShare, "of the points in sight");
  list.add_order("hypothesis_quality", "verified_quality");
  list.add("verification_frames", &o->verification_frames, {1, 1e6}, "frames");
  list.add("same_place", &o->same_place, kOverDepth, "mean depths");
  list.add("memories_tried", &o->memories_tried, {1, 1e6}, "views");
  list.add("still_here", &o->still_here, kSeconds, "s");
  list.add("server_patience", &o->server_patience, kSeconds, "s");
  list.add_part("query", list_options(&o->query));
  list.add_part("places", list_options(&o->places));
  list.add_part("views", list_options(&o->views));
  list.add_part("rounds", list_options(&o->rounds));
  list.add_part("path", list_options(&o->path));
  return list;
}

}  // namespace

OptionList list_options(TrackerOptions* o) {
  OptionList list(member_count<TrackerOptions>() - 3);  // choices of a run: tracker_options.h
  list.add("lost_quality", &o->lost_quality, kShare, "of the points in sight");
  list.add("good_quality", &o->good_quality, kShare, "of the points in sight");
  list.add_order("lost_quality", "good_quality");
  list.add("same_view", &o->same_view, {-1, 1}, "correlation");
  list.add_part("finder", list_options(&o->finder));
  list.add_part("evidence", list_options(&o->evidence));
  list.add_part("motion", list_options(&o->motion));
  list.add_part("gyro", list_options(&o->gyro));
  list.add_part("step_correction", list_options(&o->step_correction));
  list.add_part("flow", list_options(&o->flow));
  list.add_part("exposure", list_options(&o->exposure));
  list.add_part("keyframes", list_options(&o->keyframes));
  list.add_part("trails", list_options(&o->trails));
  list.add_part("trail_pose", list_options(&o->trail_pose));
  list.add_part("judgement", list_options(&o->judgement));
  list.add_part("provisional", list_options(&o->provisional));
  list.add_part("reckoning", list_options(&o->reckoning));
  list.add_part("local", list_options(&o->local));
  list.add_part("still", list_options(&o->still));
  list.add_part("recovery", list_options(&o->recovery));
  list.add_order("lost_quality", "recovery.verified_quality");
  return list;
}

}  // namespace cairn
