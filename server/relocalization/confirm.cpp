// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/confirm.h"

#include <fmt/format.h>
#include <algorithm>
#include <iterator>
#include <limits>
#include <ranges>
#include <utility>

#include "server/relocalization/appearance.h"
#include "server/relocalization/picture_parts.h"

namespace cairn {
namespace {

constexpr int kAgreeingInPart = 2;        ///< one may agree by chance
constexpr double kRansacThreshold = 2.5;  ///< [px of the corner's level]
constexpr size_t kNeighbourhood = 4;      ///< keyframes whose points are looked for around a pose
constexpr double kAngleWeight = 1;        ///< a radian between optical axes counts as one mean depth apart
/// Radius of the search around a pose [px of the corner's level]: that of three points is rough yet.
constexpr double kRadii[] = {6, 4, 2.5};
constexpr double kCertainty = 3;        ///< sigmas of where a point is expected that the radius must hold
constexpr size_t kEnoughForPose = 200;  ///< points of which a pose is refined, before all are looked for

/// The keyframe that a pose comes from, and those of the others that see about what the pose sees.
std::vector<size_t> keyframes_around(const IndexedMap& map, const SE3& camera_from_map, size_t keyframe) {
  std::vector<std::pair<double, size_t>> ranked;
  const Eigen::Vector3d axis = camera_from_map.rotation_matrix().row(2);
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    const KeyframePose* pose = map.snapshot->find(map.keyframes[i]->id);
    if (pose == nullptr || i == keyframe) continue;
    const double depth = std::max(1e-6, static_cast<double>(pose->mean_depth));
    const double distance = (pose->camera_from_map.center() - camera_from_map.center()).norm() / depth;
    const Eigen::Vector3d its_axis = pose->camera_from_map.rotation_matrix().row(2);
    ranked.emplace_back(distance + kAngleWeight * (its_axis - axis).norm(), i);
  }
  std::sort(ranked.begin(), ranked.end());
  ranked.resize(std::min(ranked.size(), kNeighbourhood - 1));
  std::vector<size_t> around = {keyframe};
  for (const auto& [_, i] : ranked) around.push_back(i);
  return around;
}

/// Corners of the matches that agree with the pose, ascending.
std::vector<size_t> corners_found(std::span<const PlaceMatch> matches, std::span<const double> weights) {
  std::vector<size_t> found;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (weights[i] > 0) found.push_back(matches[i].corner);
  }
  return found;
}

/// Parts of the picture in which at least so many of the corners lie.
int count_parts(const PlaceView& view, std::span<const size_t> corners, const Camera& camera, int fewest) {
  PerPart<int> inside{};
  for (const size_t corner : corners) ++inside[part_of(view.corners[corner].pixel, camera)];
  return static_cast<int>(std::ranges::count_if(inside, [&](int count) { return count >= fewest; }));
}

ExplainedCorner explain(const PlaceView& view, const Camera& camera, const PlaceMatch& match) {
  return {match.corner, camera.unproject(view.corners[match.corner].pixel.cast<double>()), match.position};
}

/// Those that agree with the pose, and of the others those whose corners these are not.
void explain_found(const PlaceView& view, const Camera& camera, std::span<const PlaceMatch> matches,
                   std::span<const double> weights, std::vector<ExplainedCorner>* explained) {
  std::vector<ExplainedCorner> both;
  for (size_t i = 0; i < matches.size(); ++i)
    if (weights[i] > 0) both.push_back(explain(view, camera, matches[i]));
  both.insert(both.end(), explained->begin(), explained->end());
  std::ranges::stable_sort(both, {}, &ExplainedCorner::corner);
  const auto doubles = std::ranges::unique(both, {}, &ExplainedCorner::corner);
  both.erase(doubles.begin(), doubles.end());
  *explained = std::move(both);
}

bool speak(const ConfirmOptions::Witnesses& needed, const Confirmation& said) {
  return said.alikeness >= needed.alikeness && evidence(said) >= needed.evidence &&
         said.inliers >= needed.of_met * said.met && said.inliers >= needed.of_expected * said.expected &&
         said.agreeing_parts >= needed.agreeing_parts && said.strange_parts <= needed.strange_parts;
}

bool do_enough_agree(const ConfirmOptions& options, const Confirmation& said) {
  return said.agreeing >= options.enough_agreeing;
}

/// A part of the place has moved.
bool does_the_rest_stand(const ConfirmOptions& options, const Confirmation& said) {
  return do_enough_agree(options, said) && speak(options.by_extent, said);
}

bool does_look_right(const ConfirmOptions& options, const Confirmation& said) {
  if (!do_enough_agree(options, said)) return speak(options.by_few, said);
  return speak(options.by_picture, said) || speak(options.by_points, said);
}

void judge(const ConfirmOptions& options, Confirmation* result) {
  const bool looks_right = does_look_right(options, *result);
  if (result->inliers < options.min_inliers) {
    result->reason = fmt::format("{} points agree, {} needed", result->inliers, options.min_inliers);
  } else if (result->parts < options.min_parts) {
    result->reason = fmt::format("points in few parts of the picture only ({} of {})", result->parts, kParts);
  } else if (!looks_right && !does_the_rest_stand(options, *result)) {
    result->reason = fmt::format(
        "{} of {} corners and points that meet look alike, the picture by {:.2f}, {:.2f} of what moved "
        "together agrees: {:.2f} in all; corners agree in {} of {} parts, {} parts show something else",
        result->inliers, result->met, result->alikeness, unity(*result), evidence(*result),
        result->agreeing_parts, kParts, result->strange_parts);
  } else {
    result->confirmed = true;
    result->changed = !looks_right;
  }
}

/// The pose with which most matches agree, from three of those that are supported.
Result<PoseEstimate> find_pose(const PlaceView& view, const Camera& camera,
                               std::span<const PlaceMatch> matches, std::span<const PlaceMatch> supported,
                               const ConfirmOptions& options) {
  PoseRansacOptions ransac;
  ransac.threshold = kRansacThreshold;
  ransac.iterations = options.ransac_iterations;
  ransac.min_inliers = 0;
  ransac.seed = options.seed;
  const auto pose = ransac_pose(camera, to_observations(view, supported), ransac);
  if (!pose) return pose;
  PoseOptions all;
  all.fixed_cutoff_after = 0;
  all.late_squared_cutoff = kRansacThreshold * kRansacThreshold;
  return optimize_pose(camera, pose->camera_from_map, to_observations(view, matches), all);
}

/// [px^2] of where a pose puts a point, as far as the pose is uncertain.
double variance_of_pixel(const Camera& camera, const PoseEstimate& pose, const Eigen::Vector3d& point) {
  const Eigen::Vector3d seen = pose.camera_from_map * point;
  Matrix23d d_pixel_d_point;
  if (!camera.project(seen, &d_pixel_d_point)) return std::numeric_limits<double>::infinity();
  Eigen::Matrix<double, 2, 6> d_pixel_d_pose;
  d_pixel_d_pose.leftCols<3>() = d_pixel_d_point;
  for (int i = 0; i < 2; ++i)
    d_pixel_d_pose.block<1, 3>(i, 3) = seen.cross(d_pixel_d_point.row(i).transpose()).transpose();
  return (d_pixel_d_pose * pose.covariance * d_pixel_d_pose.transpose()).trace();
}

/// Leaves the points that a search of that radius finds where they are. A pose from corners that lie close
/// together is known there and not elsewhere: what is looked for elsewhere is matched wrongly and holds the
/// pose where it is.
void keep_certain(const Camera& camera, const PoseEstimate& pose, double radius, ProjectedPoints* points) {
  std::erase_if(points->points, [&](const ProjectedPoint& point) {
    const auto level_of = [](const KeyframeSighting& s) { return s.sighting->level; };
    const int finest = std::ranges::min(points->sightings_of(point) | std::views::transform(level_of));
    const double reach = radius * (1 << finest) / kCertainty;
    return variance_of_pixel(camera, pose, point.position) > reach * reach;
  });
}

/// Leaves so many, evenly.
void keep_some(size_t count, std::vector<ProjectedPoint>* points) {
  if (points->size() <= count) return;
  const size_t all = points->size();
  for (size_t i = 0; i < count; ++i) (*points)[i] = (*points)[i * all / count];
  points->resize(count);
}

/// All that is found around a pose.
struct Refined {
  PoseEstimate pose;
  ProjectedPoints points;
  GuidedMatches guided;
};

/// Of corners that lie close together comes a pose from which the rest is found step by step, as far as each
/// pose can tell where it is; by the last, everything.
Result<Refined> refine(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                       const IndexedMap& map, size_t keyframe, PoseEstimate pose) {
  Refined refined{std::move(pose), {}, {}};
  for (const double radius : kRadii) {
    const SE3 camera_from_map = refined.pose.camera_from_map;
    project_points(camera, camera_from_map, map, keyframes_around(map, camera_from_map, keyframe),
                   &refined.points);
    if (radius != *std::prev(std::end(kRadii))) {
      keep_certain(camera, refined.pose, radius, &refined.points);
      keep_some(kEnoughForPose, &refined.points.points);
    }
    refined.guided = match_near(view, grid, refined.points, radius);
    PoseOptions options;
    options.fixed_cutoff_after = 0;
    options.late_squared_cutoff = radius * radius;
    auto next =
        optimize_pose(camera, camera_from_map, to_observations(view, refined.guided.matches), options);
    if (!next) return tl::unexpected(next.error());
    refined.pose = std::move(*next);
  }
  return refined;
}

/// Of the matches those that do not agree with the pose, which finds another point at their corner.
int count_repeated(const PlaceView& view, const Camera& camera, std::span<const PlaceMatch> matches,
                   const SE3& camera_from_map, std::span<const size_t> found) {
  return static_cast<int>(std::ranges::count_if(matches, [&](const PlaceMatch& m) {
    const PlaceCorner& corner = view.corners[m.corner];
    const auto pixel = camera.project(camera_from_map * m.position);
    const bool agrees =
        pixel && (*pixel - corner.pixel.cast<double>()).norm() <= kRansacThreshold * (1 << corner.level);
    return !agrees && std::ranges::binary_search(found, m.corner);
  }));
}

}  // namespace

double unity(const Confirmation& said) {
  return std::min(1.0, static_cast<double>(said.agreeing + said.repeated) / std::max(1, said.supported));
}

double evidence(const Confirmation& said) {
  return (2 * said.alikeness + said.order + unity(said)) / 4;
}

Confirmation confirm(const PlaceView& view, std::span<const CellList> cells, const CornerGrid& grid,
                     const Camera& camera, const IndexedMap& map, size_t keyframe,
                     const ConfirmOptions& options) {
  Confirmation result;
  const auto matches = match_anywhere(view, cells, map, keyframe);
  const auto supported = keep_supported(view, matches);
  result.matches = static_cast<int>(matches.size());
  result.supported = static_cast<int>(supported.size());
  for (const PlaceMatch& m : supported) result.explained.push_back(explain(view, camera, m));
  if (result.supported < options.min_supported) {
    result.reason = fmt::format("{} of {} corners alike lie as they do there, {} needed", result.supported,
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
  result.agreeing_parts = count_parts(view, corners_found(matches, pose->weights), camera, kAgreeingInPart);
  const auto refined = refine(view, grid, camera, map, keyframe, *pose);
  if (!refined) {
    result.reason = refined.error().message;
    return result;
  }
  const auto& [final_pose, points, guided] = *refined;
  result.camera_from_map = final_pose.camera_from_map;
  result.inliers = final_pose.inliers;
  result.expected = static_cast<int>(points.points.size());
  result.met = static_cast<int>(guided.met);
  result.found = corners_found(guided.matches, final_pose.weights);
  result.repeated = count_repeated(view, camera, supported, result.camera_from_map, result.found);
  result.parts = count_parts(view, result.found, camera, 1);
  const Appearance appearance = compare_appearance(view, camera, points);
  result.alikeness = appearance.local;
  result.order = appearance.order;
  result.strange_parts = appearance.strange_parts;
  judge(options, &result);
  if (result.confirmed || do_enough_agree(options, result))
    explain_found(view, camera, guided.matches, final_pose.weights, &result.explained);
  return result;
}

}  // namespace cairn
