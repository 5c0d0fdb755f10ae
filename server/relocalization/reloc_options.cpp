// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <string>

#include "common/base/member_count.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

// Ranges are what the code stands, not what is sensible.
constexpr OptionList::Range kShare = {0, 1};
constexpr OptionList::Range kCorrelation = {-1, 1};
constexpr OptionList::Range kCount = {0, 1e6};
constexpr OptionList::Range kCellRange = {0, kImageCells};
constexpr OptionList::Range kRadius = {0.1, 1000};
constexpr OptionList::Range kBits = {0, 256};
constexpr OptionList::Range kPixels = {0, 1e4};
constexpr OptionList::Range kTilt = {1e-6, 1.5};
constexpr OptionList::Range kNearness = {0, 1000};

template <size_t kSteps>
void add_radii(std::array<double, kSteps>* radii, const char* unit, OptionList* list) {
  for (size_t i = 0; i < kSteps; ++i)
    list->add("radius_" + std::to_string(i + 1), &(*radii)[i], kRadius, unit);
}

OptionList list_options(MatchOptions* o) {
  OptionList list(member_count<MatchOptions>());
  list.add("max_distance", &o->max_distance, kBits, "bits of 256");
  list.add("ratio", &o->ratio, {0.01, 1}, "of the distance of the best rival");
  list.add("same_place", &o->same_place, kPixels, "px of level 0 times 2^level");
  list.add("max_guided_distance", &o->max_guided_distance, kBits, "bits of 256");
  list.add("neighbourhood", &o->neighbourhood, kPixels, "px");
  list.add("motion_noise", &o->motion_noise, kPixels, "px");
  list.add("motion_change", &o->motion_change, {0, 10}, "px of motion per px apart");
  list.add("fewest_supporters", &o->fewest_supporters, kCount, "matches");
  return list;
}

OptionList list_options(AppearanceOptions* o) {
  OptionList list(member_count<AppearanceOptions>());
  list.add("behind", &o->behind, {1, 1000}, "of the depth beside it");
  list.add("inconsistent", &o->inconsistent, kCorrelation, "correlation");
  list.add("standard_errors", &o->standard_errors, {0, 1000});
  list.add("fewest_points", &o->fewest_points, {1, 1e6}, "points");
  return list;
}

OptionList list_options(RefineOptions* o) {
  OptionList list(member_count<RefineOptions>() - 1 + o->radii.size());
  list.add("neighbourhood", &o->neighbourhood, {1, 1000}, "keyframes");
  list.add("angle_weight", &o->angle_weight, kNearness, "mean depths per rad");
  add_radii(&o->radii, "px of the corner's level", &list);
  list.add("certainty", &o->certainty, {0.1, 100}, "sigma");
  list.add("enough_for_pose", &o->enough_for_pose, {3, 1e6}, "points");
  return list;
}

OptionList list_options(SettleOptions* o) {
  OptionList list(member_count<SettleOptions>() - 1 + o->radii.size());
  list.add("aside", &o->aside, kShare, "median depths, and rad");
  list.add("most_moves", &o->most_moves, {0, 1000});
  list.add("nearly_as_good", &o->nearly_as_good, kShare, "of the support");
  list.add("most_refined", &o->most_refined, {0, 1000}, "poses");
  list.add("sampled", &o->sampled, {3, 1e6}, "points");
  add_radii(&o->radii, "px of the corner's level", &list);
  list.add("same", &o->same, kShare, "median depths plus rad");
  return list;
}

OptionList list_options(GravityOptions* o) {
  OptionList list(member_count<GravityOptions>());
  list.add("chi_square", &o->chi_square, {0, 1e4}, "sigma^2");
  list.add("pose_tilt", &o->pose_tilt, kTilt, "rad");
  list.add("most_contradict", &o->most_contradict, kShare, "of the keyframes");
  list.add("common_sigma", &o->common_sigma, kTilt, "rad");
  return list;
}

OptionList list_options(ForestOptions* o) {
  OptionList list(member_count<ForestOptions>());
  list.add("trees", &o->trees, {1, 64}, "trees");
  list.add("checks", &o->checks, {1, 1e6}, "images");
  return list;
}

OptionList list_options(ConfirmOptions::Acceptance* o) {
  OptionList list(member_count<ConfirmOptions::Acceptance>());
  list.add("similarity", &o->similarity, kCorrelation, "correlation");
  list.add("evidence", &o->evidence, kCorrelation);
  list.add("of_met", &o->of_met, kShare, "of the matches that could be");
  list.add("of_expected", &o->of_expected, kShare, "of the points expected");
  list.add("agreeing_cells", &o->agreeing_cells, kCellRange, "cells");
  list.add("inconsistent_cells", &o->inconsistent_cells, kCellRange, "cells");
  return list;
}

OptionList list_options(ConfirmOptions* o) {
  OptionList list(member_count<ConfirmOptions>() - 1);  // the seed is a choice of a run
  list.add("rough_step", &o->rough_step, {1, 1000}, "points");
  list.add("agreeing_in_cell", &o->agreeing_in_cell, {1, 1e6}, "corners");
  list.add("min_supported", &o->min_supported, {3, 1e6}, "matches");
  list.add("ransac_threshold", &o->ransac_threshold, kRadius, "px of the corner's level");
  list.add("ransac_iterations", &o->ransac_iterations, {1, 1e6});
  list.add("min_agreeing", &o->min_agreeing, {3, 1e6}, "corners");
  list.add("enough_agreeing", &o->enough_agreeing, {3, 1e6}, "corners");
  list.add("many_agreeing", &o->many_agreeing, {3, 1e6}, "corners");
  list.add_order("min_agreeing", "enough_agreeing").add_order("enough_agreeing", "many_agreeing");
  list.add("min_inliers", &o->min_inliers, {3, 1e6}, "points");
  list.add("min_cells", &o->min_cells, kCellRange, "cells");
  list.add("clear_agreeing", &o->clear_agreeing, kCount, "corners");
  list.add("clear_evidence", &o->clear_evidence, kCorrelation);
  list.add("least_evidence", &o->least_evidence, kCorrelation);
  list.add("least_similarity", &o->least_similarity, kCorrelation, "correlation");
  list.add("most_sigma", &o->most_sigma, kNearness, "median depths");
  list.add_part("by_image", list_options(&o->by_image));
  list.add_part("by_points", list_options(&o->by_points));
  list.add_part("by_extent", list_options(&o->by_extent));
  list.add_part("by_few", list_options(&o->by_few));
  list.add_part("match", list_options(&o->match));
  list.add_part("appearance", list_options(&o->appearance));
  list.add_part("refine", list_options(&o->refine));
  list.add_part("settle", list_options(&o->settle));
  list.add_part("gravity", list_options(&o->gravity));
  return list;
}

OptionList list_options(OverlapOptions* o) {
  OptionList list(member_count<OverlapOptions>() - 1 + member_count<MapAgreementOptions>());
  list.add("most_maps", &o->most_maps, {1, 1e3}, "maps");
  list.add("most_shown", &o->most_shown, {1, 1e4}, "keyframes");
  list.add("next_to", &o->next_to, kNearness, "mean depths plus rad");
  list.add("least_keyframes", &o->least_keyframes, {2, 1e4}, "keyframes");
  list.add_order("least_keyframes", "most_shown");
  list.add("same_pose", &o->agreement.same_pose, kNearness, "mean depths plus rad");
  list.add("least_base", &o->agreement.least_base, kNearness, "mean depths");
  return list;
}

OptionList list_options(VoteOptions* o) {
  OptionList list(member_count<VoteOptions>());
  list.add("cells", &o->cells, {1, kProbedCells}, "cells of the vocabulary");
  return list;
}

}  // namespace

OptionList list_options(RelocOptions* o) {
  OptionList list(member_count<RelocOptions>() - 2);  // choices of a run: relocalizer.h
  list.add("by_image_alone", &o->by_image_alone, kCount, "keyframes");
  list.add("shortlist", &o->shortlist, {1, 1e6}, "keyframes");
  list.add("most_scanned", &o->most_scanned, {1, 1e9}, "images");
  list.add("images_near", &o->images_near, {1, 1e9}, "images");
  list.add("fused", &o->fused, {1, 1e6}, "keyframes");
  list.add("fusion_damping", &o->fusion_damping, kCount);
  list.add("most_poses", &o->most_poses, {1, 1e6}, "poses");
  list.add("more_for_rivals", &o->more_for_rivals, kCount, "poses");
  list.add("more_for_pose", &o->more_for_pose, kCount, "poses");
  list.add("sure_similarity", &o->sure_similarity, kCorrelation, "correlation");
  list.add("hypotheses_of_place", &o->hypotheses_of_place, {1, 1e6}, "keyframes");
  list.add("neighbours_of_lead", &o->neighbours_of_lead, kCount, "keyframes");
  list.add("hypotheses_of_leads", &o->hypotheses_of_leads, kCount, "keyframes");
  list.add("in_common", &o->in_common, {1, 1e6}, "points");
  list.add("same_pose", &o->same_pose, kNearness, "mean depths plus rad");
  list.add("least_peculiar", &o->least_peculiar, kShare, "of the corners found");
  list.add("least_margin", &o->least_margin, {1, 1000}, "of a rival's corners");
  list.add("outvoted_by", &o->outvoted_by, {1, 1e6}, "keyframes for each that confirms");
  list.add_part("forest", list_options(&o->forest));
  list.add_part("votes", list_options(&o->votes));
  list.add_part("confirm", list_options(&o->confirm));
  list.add_part("overlap", list_options(&o->overlap));
  return list;
}

}  // namespace cairn
