// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/confirm.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <utility>

#include "server/relocalization/gravity.h"
#include "server/relocalization/image_cells.h"

namespace cairn {
namespace {

/// Corners of the matches that agree with the pose (weight above 0), ascending.
std::vector<size_t> corners_found(std::span<const PlaceMatch> matches, std::span<const double> weights) {
  std::vector<size_t> found;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (weights[i] > 0) found.push_back(matches[i].corner);
  }
  return found;
}

/// Number of cells of the image in which at least `fewest` of the corners lie.
int count_cells(const PlaceView& view, std::span<const size_t> corners, const Camera& camera, int fewest) {
  PerCell<int> inside{};
  for (const size_t corner : corners) ++inside[image_cell_of(view.corners[corner].pixel, camera)];
  return static_cast<int>(std::ranges::count_if(inside, [&](int count) { return count >= fewest; }));
}

ExplainedCorner explain(const PlaceView& view, const Camera& camera, const PlaceMatch& match) {
  return {match.corner, camera.unproject(view.corners[match.corner].pixel.cast<double>()), match.position};
}

/// Merges the matches that agree with the pose into `explained`; of entries with the same corner the match
/// stays.
void explain_found(const PlaceView& view, const Camera& camera, std::span<const PlaceMatch> matches,
                   std::span<const double> weights, std::vector<ExplainedCorner>* explained) {
  std::vector<ExplainedCorner> both;
  for (size_t i = 0; i < matches.size(); ++i)
    if (weights[i] > 0) both.push_back(explain(view, camera, matches[i]));
  both.insert(both.end(), explained->begin(), explained->end());
  std::ranges::stable_sort(both, {}, &ExplainedCorner::corner);
  const auto is_same = [](const ExplainedCorner& a, const ExplainedCorner& b) {
    return a.corner == b.corner;
  };
  both.erase(std::unique(both.begin(), both.end(), is_same), both.end());
  *explained = std::move(both);
}

bool speak(const ConfirmOptions::Acceptance& needed, const Confirmation& said) {
  return said.similarity >= needed.similarity && evidence(said) >= needed.evidence &&
         said.inliers >= needed.of_met * said.met && said.inliers >= needed.of_expected * said.expected &&
         said.agreeing_cells >= needed.agreeing_cells && said.inconsistent_cells <= needed.inconsistent_cells;
}

bool do_enough_agree(const ConfirmOptions& options, const Confirmation& said) {
  return said.agreeing >= options.enough_agreeing;
}

/// Whether the place is accepted `by_extent`: a part of it has moved, and the rest agrees.
bool does_the_rest_stand(const ConfirmOptions& options, const Confirmation& said) {
  return do_enough_agree(options, said) && speak(options.by_extent, said);
}

/// ConfirmOptions::by_image with the evidence that it needs for so many agreeing corners: the fewer agree,
/// the more evidence, without a step between few and enough.
ConfirmOptions::Acceptance by_image(const ConfirmOptions& options, const Confirmation& said) {
  ConfirmOptions::Acceptance needed = options.by_image;
  const double lacking = options.many_agreeing - said.agreeing;
  const double at_most = options.many_agreeing - options.enough_agreeing + 1;
  needed.evidence =
      std::lerp(needed.evidence, options.by_few.evidence, std::clamp(lacking / at_most, 0.0, 1.0));
  return needed;
}

bool does_look_right(const ConfirmOptions& options, const Confirmation& said) {
  if (!do_enough_agree(options, said)) return speak(options.by_few, said);
  return speak(by_image(options, said), said) || speak(options.by_points, said);
}

std::string why_not_upright(int agreeing) {
  return fmt::format("{} corners agree on a pose in which the camera is held otherwise than gravity says",
                     agreeing);
}

/// Decides whether the place is confirmed. Gravity is checked again, since the refined pose may have turned
/// away from the one that was upright.
void judge(const PlaceView& view, const IndexedMap& map, const ConfirmOptions& options,
           Confirmation* result) {
  const bool looks_right = does_look_right(options, *result);
  if (!is_upright(*result->camera_from_map, map.up, view.up, options.gravity)) {
    result->reason = why_not_upright(result->inliers);
  } else if (result->inliers < options.min_inliers) {
    result->reason = fmt::format("{} points agree, {} needed", result->inliers, options.min_inliers);
  } else if (result->occupied_cells < options.min_cells) {
    result->reason =
        fmt::format("points in few parts of the image only ({} of {})", result->occupied_cells, kImageCells);
  } else if (!looks_right && !does_the_rest_stand(options, *result)) {
    result->reason = fmt::format(
        "{} of {} possible matches are found, image similarity {:.2f}, {:.2f} of what moved together agrees: "
        "evidence {:.2f}; corners agree in {} of {} cells, {} cells are inconsistent",
        result->inliers, result->met, result->similarity, unity(*result), evidence(*result),
        result->agreeing_cells, kImageCells, result->inconsistent_cells);
  } else {
    result->confirmed = true;
    result->changed = !looks_right;
  }
}

/// The first pose: the one from three supported matches with which most of these agree, optimized over all
/// `matches`.
Result<PoseEstimate> find_pose(const PlaceView& view, const Camera& camera,
                               std::span<const PlaceMatch> matches, std::span<const PlaceMatch> supported,
                               const ConfirmOptions& options) {
  PoseRansacOptions ransac;
  ransac.threshold = options.ransac_threshold;
  ransac.iterations = options.ransac_iterations;
  ransac.min_inliers = 0;
  ransac.seed = options.seed;
  auto pose = ransac_pose(camera, to_observations(view, supported), ransac);
  if (!pose) return pose;
  PoseOptions all;
  all.fixed_cutoff_after = 0;
  all.late_squared_cutoff = options.ransac_threshold * options.ransac_threshold;
  return optimize_pose(camera, pose->camera_from_map, to_observations(view, matches), all);
}

/// Number of matches whose corners are not in `agree` but in `found`. Both are ascending.
int count_found_otherwise(std::span<const PlaceMatch> matches, std::span<const size_t> agree,
                          std::span<const size_t> found) {
  return static_cast<int>(std::ranges::count_if(matches, [&](const PlaceMatch& m) {
    return !std::ranges::binary_search(agree, m.corner) && std::ranges::binary_search(found, m.corner);
  }));
}

/// Checks whether it is worth while to refine the pose, by how alike some of the keyframe's points look
/// there; `result` takes over that similarity. An error: it is not. Most wrong poses end here, for a small
/// part of what refining them costs.
Status check_roughly(const PlaceView& view, const Camera& camera, const IndexedMap& map, size_t keyframe,
                     const ConfirmOptions& options, Confirmation* result) {
  if (result->agreeing_cells >= options.by_extent.agreeing_cells) return {};
  ProjectedPoints points;
  project_points(camera, *result->camera_from_map, map, std::span(&keyframe, 1), white_share(view.small),
                 &points, options.rough_step);
  const Appearance rough = compare_appearance(view, camera, points, options.appearance);
  result->similarity = rough.local;
  result->order = rough.order;
  if (evidence(*result) >= options.least_evidence && rough.local >= options.least_similarity) return {};
  return fail(ErrorCode::kDegenerate,
              fmt::format("{} corners agree on a pose of image similarity {:.2f}: evidence {:.2f}",
                          result->agreeing, rough.local, evidence(*result)));
}

/// Median depth [map unit] of points that a pose sees. Precondition: `points` are not empty.
double median_depth(const ProjectedPoints& points) {
  std::vector<double> depths;
  for (const ProjectedPoint& point : points.points) depths.push_back(point.depth);
  const auto middle = depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2);
  std::ranges::nth_element(depths, middle);
  return *middle;
}

/// Sets in `result` the refined pose and what is seen with it.
void take_refined(const PlaceView& view, const Camera& camera, const Refined& refined,
                  const AppearanceOptions& options, Confirmation* result) {
  result->camera_from_map = refined.pose.camera_from_map;
  result->inliers = refined.pose.inliers;
  result->expected = static_cast<int>(refined.points.points.size());
  result->met = static_cast<int>(refined.guided.met);
  result->found = corners_found(refined.guided.matches, refined.pose.weights);
  result->occupied_cells = count_cells(view, result->found, camera, 1);
  const Appearance appearance = compare_appearance(view, camera, refined.points, options);
  result->similarity = appearance.local;
  result->order = appearance.order;
  result->inconsistent_cells = appearance.inconsistent_cells;
}

}  // namespace

double unity(const Confirmation& said) {
  return std::min(1.0,
                  static_cast<double>(said.agreeing + said.found_otherwise) / std::max(1, said.supported));
}

double evidence(const Confirmation& said) {
  return (2 * said.similarity + said.order + unity(said)) / 4;
}

Confirmation confirm(const PlaceView& view, std::span<const CellList> cells, const CornerGrid& grid,
                     const Camera& camera, const IndexedMap& map, size_t keyframe, const Prefilter& prefilter,
                     const ConfirmOptions& options) {
  Confirmation result;
  if (prefilter.supported == 0) {
    result.matches = static_cast<int>(prefilter.distinct);
    result.reason = fmt::format("none of {} matched corners lies as it does there", result.matches);
    return result;
  }
  const auto matches = match_closer(view, cells, map, keyframe, prefilter, options.match);
  const auto supported = keep_supported(view, matches, options.match);
  result.matches = static_cast<int>(matches.size());
  result.supported = static_cast<int>(supported.size());
  for (const PlaceMatch& m : supported) result.explained.push_back(explain(view, camera, m));
  if (result.supported < options.min_supported) {
    result.reason = fmt::format("{} of {} matched corners lie as they do there, {} needed", result.supported,
                                result.matches, options.min_supported);
    return result;
  }
  const auto pose = find_pose(view, camera, matches, supported, options);
  if (!pose || pose->inliers < options.min_agreeing) {
    result.agreeing = pose ? pose->inliers : 0;
    result.reason =
        pose ? fmt::format("{} corners agree on a pose, {} needed", result.agreeing, options.min_agreeing)
             : pose.error().message;
    return result;
  }
  result.agreeing = pose->inliers;
  if (!is_upright(pose->camera_from_map, map.up, view.up, options.gravity)) {
    result.explained.clear();  // what is held otherwise is not there, and no rival of what is
    result.reason = why_not_upright(result.agreeing);
    return result;
  }
  result.camera_from_map = pose->camera_from_map;
  const std::vector<size_t> agree = corners_found(matches, pose->weights);
  result.agreeing_cells = count_cells(view, agree, camera, options.agreeing_in_cell);
  const auto refined = check_roughly(view, camera, map, keyframe, options, &result).and_then([&] {
    return refine(view, grid, camera, map, keyframe, *pose, options.refine, options.match);
  });
  if (refined) {
    take_refined(view, camera, *refined, options.appearance, &result);
    result.found_otherwise = count_found_otherwise(supported, agree, result.found);
    judge(view, map, options, &result);
  } else {
    result.reason = refined.error().message;
  }
  if (!result.confirmed && !do_enough_agree(options, result)) return result;
  explain_found(view, camera, refined ? refined->guided.matches : matches,
                refined ? refined->pose.weights : pose->weights, &result.explained);
  return result;
}

void confirm_settled(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                     const IndexedMap& map, size_t keyframe, const ConfirmOptions& options,
                     Confirmation* said) {
  auto refined = refine(view, grid, camera, map, keyframe, as_certain(*said->camera_from_map), options.refine,
                        options.match);
  said->confirmed = false;
  if (!refined) {
    said->reason = refined.error().message;
    return;
  }
  const double depth = median_depth(refined->points);
  const Refined settled = settle(view, grid, camera, map, keyframe, std::move(*refined), depth,
                                 options.settle, options.refine, options.match);
  take_refined(view, camera, settled, options.appearance, said);
  judge(view, map, options, said);
  const double sigma = position_sigma(view, camera, settled) / depth;
  if (!said->confirmed || sigma <= options.most_sigma) return;
  said->confirmed = false;
  said->reason =
      fmt::format("what is seen leaves the position open by {:.1f} % of the depth, {:.1f} are allowed",
                  100 * sigma, 100 * options.most_sigma);
}

}  // namespace cairn
