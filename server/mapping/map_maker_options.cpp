// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_maker_options.h"

#include <numbers>

#include "common/base/member_count.h"
#include "common/image/pyramid.h"

namespace cairn {
namespace {

// Ranges are what the code stands, not what is sensible.
constexpr OptionList::Range kShare = {0, 1};
constexpr OptionList::Range kCosine = {-1, 1};
constexpr OptionList::Range kPixels = {0, 1000};
constexpr OptionList::Range kAngle = {0, std::numbers::pi};
constexpr OptionList::Range kSquared = {0, 1e6};
constexpr OptionList::Range kCount = {0, 1e6};

OptionList list_options(EpipolarOptions* o) {
  OptionList list(member_count<EpipolarOptions>());
  list.add("near_margin", &o->near_margin, {1e-3, 1}, "of the nearest depth");
  list.add("far_margin", &o->far_margin, {1, 1e3}, "of the farthest depth");
  list.add("line_distance", &o->line_distance, {0, 100}, "level px");
  list.add("segment_length", &o->segment_length, {1, 1e4}, "source-level px");
  list.add("max_segments", &o->max_segments, {2, 1e4}, "pieces of the line");
  list.add("pixels_per_window", &o->pixels_per_window, {1, 1e6}, "px");
  list.add("max_squared_residual", &o->max_squared_residual, kSquared, "sigma^2");
  list.add("unique_distance", &o->unique_distance, kPixels, "level px");
  list.add("unique_ratio", &o->unique_ratio, {1e-3, 1}, "of the best rival's ZMSSD");
  return list;
}

OptionList list_options(TwoViewPointOptions* o) {
  OptionList list(member_count<TwoViewPointOptions>());
  list.add("partners", &o->partners, {1, 1e3}, "keyframes");
  list.add("confirming_keyframes", &o->confirming_keyframes, {0, 1e3}, "keyframes");
  list.add("min_parallax", &o->min_parallax, kAngle, "rad");
  list.add("good_parallax", &o->good_parallax, {1e-6, std::numbers::pi}, "rad");
  list.add("wide_parallax", &o->wide_parallax, {1e-6, std::numbers::pi}, "rad");
  list.add_order("good_parallax", "wide_parallax");
  list.add("known_distance", &o->known_distance, kPixels, "level px");
  list.add("new_distance", &o->new_distance, kPixels, "level px");
  list.add("confirm_radius", &o->confirm_radius, kPixels, "level px");
  list.add("confirm_cosine", &o->confirm_cosine, kCosine, "cosine");
  list.add("overlap_samples", &o->overlap_samples, {1, 1e6}, "points");
  list.add("candidates_per_poll", &o->candidates_per_poll, {1, 1e6}, "candidates");
  list.add("corner_barrier", &o->corner_barrier, {0, 254}, "grey levels");
  list.add("corner_texture", &o->corner_texture, {0, 1e6}, "Shi-Tomasi's measure");
  list.add("image_border", &o->image_border, kPixels, "search-level px");
  list.add_part("epipolar", list_options(&o->epipolar));
  return list;
}

OptionList list_options(CandidatePointOptions* o) {
  OptionList list(member_count<CandidatePointOptions>());
  list.add("partners", &o->partners, {0, 1e3}, "keyframes");
  list.add("sigmas", &o->sigmas, {0, 100}, "sigma");
  list.add("least_share", &o->least_share, {1e-6, 1}, "of the inverse depth");
  list.add("known_depth", &o->known_depth, {0, 1e3}, "of the depth");
  list.add("measured_sigma", &o->measured_sigma, {1e-3, 100}, "search-level px");
  list.add("max_squared_residual", &o->max_squared_residual, kSquared, "search-level px^2");
  list.add("known_distance", &o->known_distance, kPixels, "level px");
  list.add("seen_cosine", &o->seen_cosine, kCosine, "cosine");
  list.add("image_border", &o->image_border, kPixels, "search-level px");
  return list;
}

OptionList list_options(RefindOptions* o) {
  OptionList list(member_count<RefindOptions>());
  list.add("radius", &o->radius, kPixels, "search-level px");
  list.add("visible_cosine", &o->visible_cosine, kCosine, "cosine");
  list.add("image_border", &o->image_border, kPixels, "search-level px");
  list.add("per_poll", &o->per_poll, {1, 1e6}, "pairs");
  return list;
}

OptionList list_options(IntegrationOptions* o) {
  OptionList list(member_count<IntegrationOptions>());
  list.add("min_measurements", &o->min_measurements, {4, 1e6}, "points");
  list.add("same_direction", &o->same_direction, kCosine, "cosine");
  list.add("new_area_distance", &o->new_area_distance, kShare, "of the spacing");
  list.add("few_known", &o->few_known, kShare, "of the reference's measurements");
  list.add("area_level", &o->area_level, {0, kPyramidLevels - 1}, "level");
  list.add("chained_radius", &o->chained_radius, kPixels, "search-level px");
  list.add("chained_share", &o->chained_share, kShare, "of the points in sight");
  list.add("max_refinement", &o->max_refinement, kPixels, "search-level px");
  list.add("least_spacing", &o->least_spacing, {0, 1e3}, "mean depths");
  list.add("most_spacing", &o->most_spacing, {0, 1e3}, "mean depths");
  list.add_order("least_spacing", "most_spacing");
  return list;
}

OptionList list_options(StartOptions* o) {
  OptionList list(member_count<StartOptions>());
  list.add("min_points", &o->min_points, {8, 1e6}, "points");
  list.add("max_rms", &o->max_rms, {0, 1e3}, "sigma");
  list.add("trail_shift", &o->trail_shift, kPixels, "px");
  list.add("plane_distance", &o->plane_distance, kShare, "mean depths");
  list.add("plane_trials", &o->plane_trials, {1, 1e6});
  list.add("parallax_tolerance", &o->parallax_tolerance, kShare, "of the parallax a map needs");
  list.add("share_of_parallax", &o->share_of_parallax, kShare, "of the median parallax");
  return list;
}

OptionList list_options(UpkeepOptions* o) {
  OptionList list(member_count<UpkeepOptions>());
  list.add("min_attempts", &o->min_attempts, {1, 1e6}, "searches");
  list.add("min_found_fraction", &o->min_found_fraction, kShare, "of the searches");
  list.add("redundant_observers", &o->redundant_observers, {1, 1e6}, "keyframes");
  list.add("redundant_fraction", &o->redundant_fraction, kShare, "of a keyframe's points");
  list.add("newest_kept", &o->newest_kept, {1, 1e6}, "keyframes");
  return list;
}

OptionList list_options(AdjustmentOptions* o) {
  OptionList list(member_count<AdjustmentOptions>());
  list.add("local_tolerance", &o->local_tolerance, kShare, "of the cost");
  list.add("global_iterations", &o->global_iterations, {1, 1000});
  list.add("global_tolerance", &o->global_tolerance, kShare, "of the cost");
  list.add("start_rounds", &o->start_rounds, {1, 1000}, "rounds");
  return list;
}

OptionList list_options(SelfCalibrationOptions* o) {
  OptionList list(member_count<SelfCalibrationOptions>());
  list.add("known_focal_sigma", &o->known_focal_sigma, {0, 10}, "ln of the focal length");
  list.add("known_k1_sigma", &o->known_k1_sigma, {0, 100}, "k1");
  list.add("agreement", &o->agreement, {0, 10}, "ln of the focal length");
  list.add("enough_agreements", &o->enough_agreements, {1, 1e6}, "estimates");
  list.add("fewest_keyframes", &o->fewest_keyframes, kCount, "keyframes");
  list.add("fewest_of_believed", &o->fewest_of_believed, kCount, "keyframes");
  list.add("many_keyframes", &o->many_keyframes, kCount, "keyframes");
  list.add("one_more_to", &o->one_more_to, {1, 1e6}, "keyframes");
  list.add("felt_move", &o->felt_move, {0, 10}, "ln of the focal length");
  list.add("most_judged", &o->most_judged, {0, kMaxCalibratedCameras}, "cameras");
  list.add("most_free", &o->most_free, {0, kMaxCalibratedCameras}, "cameras");
  list.add("fewest_to_move", &o->fewest_to_move, {1, 1e6}, "keyframes");
  list.add("fewest_for_distortion", &o->fewest_for_distortion, kCount, "keyframes");
  list.add("held_k1_sigma", &o->held_k1_sigma, {1e-9, 100}, "k1");
  list.add("forbearance", &o->forbearance, {1, 1e6}, "of the squared cutoff");
  return list;
}

OptionList list_options(PublicationOptions* o) {
  OptionList list(member_count<PublicationOptions>());
  list.add("visible_move", &o->visible_move, kPixels, "px at the source keyframe");
  list.add("visible_turn", &o->visible_turn, {0, 2}, "rad, and of a cosine");
  list.add("visible_distance", &o->visible_distance, {0, 1e3}, "of the distance");
  list.add("better_sigma", &o->better_sigma, kShare, "of the sigma published before");
  return list;
}

}  // namespace

OptionList list_options(MapMakerOptions* o) {
  OptionList list(member_count<MapMakerOptions>() - 2);  // choices of a run: the header
  list.add("baseline", &o->baseline, {1e-6, 1e6}, "m");
  list.add("min_keyframe_distance", &o->min_keyframe_distance, kCount, "baselines over the first mean depth");
  list.add("max_points_per_keyframe", &o->max_points_per_keyframe, {1, 1e5}, "points");
  list.add("local_keyframes", &o->local_keyframes, {0, 1e4}, "keyframes");
  list.add("local_iterations", &o->local_iterations, {1, 1000});
  list.add("max_points", &o->max_points, {1, kMaxPoints}, "points");
  list.add_part("start", list_options(&o->start));
  list.add_part("integration", list_options(&o->integration));
  list.add_part("new_points", list_options(&o->new_points));
  list.add_part("candidates", list_options(&o->candidates));
  list.add_part("refind", list_options(&o->refind));
  list.add_part("upkeep", list_options(&o->upkeep));
  list.add_part("adjustment", list_options(&o->adjustment));
  list.add_part("self_calibration", list_options(&o->self_calibration));
  list.add_part("publication", list_options(&o->publication));
  return list;
}

}  // namespace cairn
