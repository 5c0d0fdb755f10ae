// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/adjustment.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/alignment.h"
#include "server/mapping/bundle_ceres.h"

namespace cairn {
namespace {

constexpr KeyframeId kFirstKeyframe{1};

/// Index of each id in an ascending list, -1 where absent; indexed by id - 1.
template <typename Id>
std::vector<int> index_by_id(const std::vector<Id>& ids, size_t count) {
  std::vector<int> index(count, -1);
  for (size_t i = 0; i < ids.size(); ++i) index[ids[i].value - 1] = static_cast<int>(i);
  return index;
}

/// The problem of the given points as seen by all their observers.
MapProblem cut_problem(const MapState& map, std::vector<PointId> points, const std::vector<bool>& moves) {
  MapProblem problem;
  // Of one view alone nothing says how far it is: it stays with its keyframe.
  std::erase_if(points, [&](PointId id) { return map.point(id).observers.size() < 2; });
  std::vector<int> pose_index(map.keyframes().size(), -1);
  for (const PointId id : points) {
    for (const KeyframeId observer : map.point(id).observers) pose_index[observer.value - 1] = 0;
  }
  for (const MapKeyframe& k : map.keyframes()) {
    int& index = pose_index[k.id.value - 1];
    if (index < 0) continue;
    index = static_cast<int>(problem.keyframes.size());
    problem.keyframes.push_back(k.id);
    problem.bundle.poses.push_back({k.camera_from_map, k.camera, !moves[k.id.value - 1]});
  }
  problem.bundle.points.reserve(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const MapPoint& point = map.point(points[i]);
    problem.bundle.points.push_back(point.position);
    for (const KeyframeId observer : point.observers) {
      const Measurement& m = *map.find_measurement(observer, points[i]);
      problem.bundle.observations.push_back(
          {pose_index[observer.value - 1], static_cast<int>(i), m.pixel.cast<double>(), m.inverse_sigma()});
    }
  }
  problem.points = std::move(points);
  return problem;
}

/// Judging takes several adjustments: only the cameras with most new keyframes, if it is worth it.
void choose_judged(const MapState& map, const SelfCalibrationOptions& options, MapProblem* problem) {
  std::vector<std::pair<ptrdiff_t, size_t>> ranked;  // minus the new keyframes, place
  for (size_t i = 0; i < problem->cameras.size(); ++i) {
    const CutCamera& cut = problem->cameras[i];
    const MapCamera& camera = map.cameras()[static_cast<size_t>(cut.index)];
    problem->bundle.free_cameras[i].judge = false;
    if (is_worth_judging(camera, cut.keyframes, options))
      ranked.emplace_back(
          static_cast<ptrdiff_t>(camera.judged_keyframes) - static_cast<ptrdiff_t>(cut.keyframes.made), i);
  }
  std::sort(ranked.begin(), ranked.end());
  ranked.resize(std::min<size_t>(ranked.size(), options.most_judged));
  for (const auto& [rank, i] : ranked) problem->bundle.free_cameras[i].judge = true;
}

/// Whether each camera of the map is moved by an adjustment, by index. Few move at a time, those with most
/// new keyframes: each is a border of the reduced system, and a map may have 64 whose clients have long gone.
std::vector<bool> choose_free(const MapState& map, const SelfCalibrationOptions& options) {
  std::vector<std::pair<ptrdiff_t, size_t>> ranked;  // minus the new keyframes, camera
  for (size_t i = 0; i < map.cameras().size(); ++i) {
    const MapCamera& c = map.cameras()[i];
    const KeyframeCount count = map.keyframes_of(static_cast<int>(i));
    if (!c.frozen && count.live >= options.fewest_to_move)
      ranked.emplace_back(static_cast<ptrdiff_t>(c.judged_keyframes) - static_cast<ptrdiff_t>(count.made), i);
  }
  std::sort(ranked.begin(), ranked.end());
  ranked.resize(std::min<size_t>(ranked.size(), options.most_free));
  std::vector<bool> free(map.cameras().size(), false);
  for (const auto& [rank, i] : ranked) free[i] = true;
  return free;
}

void free_cameras(const MapState& map, const SelfCalibrationOptions& options, MapProblem* problem) {
  const std::vector<bool> is_free = choose_free(map, options);
  std::vector<int> free_index;
  for (size_t i = 0; i < map.cameras().size(); ++i) {
    const MapCamera& c = map.cameras()[i];
    const CutCamera cut{static_cast<int>(i), c.version, map.keyframes_of(static_cast<int>(i))};
    free_index.push_back(is_free[i] ? static_cast<int>(problem->cameras.size()) : -1);
    if (!is_free[i]) continue;
    problem->cameras.push_back(cut);
    Intrinsics prior_sigma = c.prior_sigma;
    if (cut.keyframes.made < options.fewest_for_distortion) prior_sigma[1] = options.held_k1_sigma;
    problem->bundle.free_cameras.push_back({.camera = c.camera,
                                            .prior_mean = c.prior_mean,
                                            .prior_sigma = prior_sigma,
                                            .covariance = c.sigma.cwiseAbs2().asDiagonal()});
  }
  for (size_t i = 0; i < problem->keyframes.size(); ++i) {
    const int camera = map.keyframe(problem->keyframes[i]).estimated_camera;
    if (camera >= 0) problem->bundle.poses[i].free_camera = free_index[static_cast<size_t>(camera)];
  }
  choose_judged(map, options, problem);
}

void fix_gauge(MapProblem* problem) {
  std::vector<BundlePose>& poses = problem->bundle.poses;
  const bool any = std::any_of(poses.begin(), poses.end(), [](const BundlePose& p) { return p.fixed; });
  if (!any && !poses.empty()) poses.front().fixed = true;
}

/// Drops measurements with residuals beyond the cut-off. What disagrees with a camera that is not known yet
/// may be right and the camera wrong: it stays, up to `forbearance`, as the robust cost leaves it out and
/// takes it in again when the camera has moved.
void drop_outliers(const MapProblem& solved, double squared_cutoff, double forbearance, MapState* map) {
  const std::vector<double> residuals = squared_residuals(solved.bundle);
  for (size_t i = 0; i < residuals.size(); ++i) {
    if (residuals[i] < squared_cutoff) continue;
    const BundleObservation& o = solved.bundle.observations[i];
    const KeyframeId keyframe = solved.keyframes[static_cast<size_t>(o.pose)];
    if (residuals[i] < forbearance * squared_cutoff && !map->has_known_camera(map->keyframe(keyframe)))
      continue;
    const PointId point = solved.points[static_cast<size_t>(o.point)];
    if (map->find_measurement(keyframe, point)) map->drop_measurement(keyframe, point);
  }
}

void write_poses(const MapProblem& solved, MapState* map) {
  const std::vector<int> index = index_by_id(solved.keyframes, map->keyframes().size());
  std::vector<SE3> old_poses;
  old_poses.reserve(map->keyframes().size());
  for (const MapKeyframe& k : map->keyframes()) old_poses.push_back(k.camera_from_map);
  for (size_t i = 0; i < old_poses.size(); ++i) {
    MapKeyframe& k = map->keyframe(KeyframeId{i + 1});
    if (index[i] >= 0) {
      k.camera_from_map = solved.bundle.poses[static_cast<size_t>(index[i])].camera_from_map;
    } else if (k.reference) {
      const SE3& reference_old = old_poses[k.reference.value - 1];
      const SE3& reference_new = map->keyframe(k.reference).camera_from_map;
      k.camera_from_map = old_poses[i] * reference_old.inverse() * reference_new;
    }
  }
  const std::vector<int> point_index = index_by_id(solved.points, map->points().size());
  for (size_t i = 0; i < point_index.size(); ++i) {
    MapPoint& p = map->point(PointId{i + 1});
    if (!p.live) continue;
    if (point_index[i] >= 0) {
      p.position = solved.bundle.points[static_cast<size_t>(point_index[i])];
    } else {
      const KeyframeId source = p.source->keyframe;
      p.position =
          map->keyframe(source).camera_from_map.inverse() * (old_poses[source.value - 1] * p.position);
    }
  }
}

/// A local problem moves nothing but its own keyframes and points.
void write_local(const MapProblem& solved, MapState* map) {
  for (size_t i = 0; i < solved.keyframes.size(); ++i) {
    const MapKeyframe& k = map->keyframe(solved.keyframes[i]);
    const SE3 new_from_old = solved.bundle.poses[i].camera_from_map.inverse() * k.camera_from_map;
    for (const Measurement& m : k.measurements) {
      MapPoint& p = map->point(m.point);
      if (p.observers.size() < 2) p.position = new_from_old * p.position;
    }
  }
  for (size_t i = 0; i < solved.keyframes.size(); ++i) {
    map->keyframe(solved.keyframes[i]).camera_from_map = solved.bundle.poses[i].camera_from_map;
  }
  for (size_t i = 0; i < solved.points.size(); ++i)
    map->point(solved.points[i]).position = solved.bundle.points[i];
}

/// Pose of a keyframe, and the mean depth [map unit] of what it looks at.
struct Standing {
  SE3 camera_from_map;
  double depth = 0;
};

std::vector<Standing> standing_of(const MapState& map) {
  std::vector<Standing> standing;
  standing.reserve(map.keyframes().size());
  for (const MapKeyframe& k : map.keyframes()) standing.push_back({k.camera_from_map, k.mean_depth});
  return standing;
}

/// Spread of `to` about its mean over that of `from`; 1 where there is none (one keyframe).
double spread_ratio(const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to) {
  const auto spread = [](const std::vector<Eigen::Vector3d>& places) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : places) mean += p / static_cast<double>(places.size());
    double sum = 0;
    for (const Eigen::Vector3d& p : places) sum += (p - mean).squaredNorm();
    return std::sqrt(sum);
  };
  const double ratio = spread(to) / spread(from);
  return std::isfinite(ratio) && ratio > 0 ? ratio : 1.0;
}

/// Two views a few degrees apart know little of their own poses: a frame and a unit that hang on them, or on
/// the depths of their points, would move all the rest whenever these are corrected, and with it everyone's
/// pose. The unit is held by the spread of the keyframes, the frame by where they are and what they see:
/// corners of a view of 53 by 44 degrees at their depth, since keyframes that go where they look are on one
/// line with what lies ahead. Where that says nothing the map stays as the solver has left it.
void hold_frame(const MapProblem& solved, const std::vector<Standing>& before, MapState* map) {
  static const std::array<Eigen::Vector3d, 5> seen_points{
      {{0, 0, 0}, {-0.5, -0.4, 1}, {0.5, -0.4, 1}, {-0.5, 0.4, 1}, {0.5, 0.4, 1}}};
  const auto fixed = std::count_if(solved.bundle.poses.begin(), solved.bundle.poses.end(),
                                   [](const BundlePose& p) { return p.fixed; });
  if (fixed >= 2) return;
  std::vector<Eigen::Vector3d> places;
  std::vector<Eigen::Vector3d> places_before;
  for (size_t i = 0; i < before.size(); ++i) {
    if (!map->keyframes()[i].live) continue;
    places.push_back(map->keyframes()[i].camera_from_map.center());
    places_before.push_back(before[i].camera_from_map.center());
  }
  const double scale = spread_ratio(places, places_before);
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (size_t i = 0; i < before.size(); ++i) {
    const MapKeyframe& k = map->keyframes()[i];
    if (!k.live) continue;
    const Eigen::Quaterniond map_from_camera = k.camera_from_map.rotation().conjugate();
    for (const Eigen::Vector3d& seen : seen_points) {
      from.push_back(scale * k.camera_from_map.center() + map_from_camera * (before[i].depth * seen));
      to.push_back(before[i].camera_from_map.inverse() * (before[i].depth * seen));
    }
  }
  const auto back = align_points(from, to, false);
  if (back) map->transform({scale, back->rotation(), back->translation()});
}

}  // namespace

MapProblem local_problem(const MapState& map, KeyframeId newest, int neighbours) {
  const std::vector<int> shared = map.shared_points(map.keyframe(newest).measurements);
  std::vector<std::pair<int, KeyframeId>> ranked;
  for (const MapKeyframe& k : map.keyframes()) {
    const int count = shared[k.id.value - 1];
    if (k.live && k.id != newest && k.id != kFirstKeyframe && count > 0) ranked.emplace_back(-count, k.id);
  }
  std::sort(ranked.begin(), ranked.end());
  ranked.resize(std::min(ranked.size(), static_cast<size_t>(neighbours)));

  std::vector<bool> moves(map.keyframes().size(), false);
  if (newest != kFirstKeyframe) moves[newest.value - 1] = true;
  for (const auto& [count, id] : ranked) moves[id.value - 1] = true;
  std::vector<PointId> points;
  for (const MapKeyframe& k : map.keyframes()) {
    if (!moves[k.id.value - 1]) continue;
    for (const Measurement& m : k.measurements) points.push_back(m.point);
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  MapProblem problem = cut_problem(map, std::move(points), moves);
  fix_gauge(&problem);
  return problem;
}

MapProblem global_problem(const MapState& map, const SelfCalibrationOptions& options) {
  std::vector<bool> moves(map.keyframes().size(), true);
  moves[kFirstKeyframe.value - 1] = false;
  std::vector<PointId> points;
  for (const MapPoint& p : map.points()) {
    if (p.live) points.push_back(p.id);
  }
  MapProblem problem = cut_problem(map, std::move(points), moves);
  fix_gauge(&problem);
  free_cameras(map, options, &problem);
  return problem;
}

void write_back(const MapProblem& solved, double squared_cutoff, const SelfCalibrationOptions& options,
                MapState* map) {
  const std::vector<Standing> before = standing_of(*map);
  write_poses(solved, map);
  for (size_t i = 0; i < solved.cameras.size(); ++i)
    map->update_camera(solved.cameras[i], solved.bundle.free_cameras[i], options);
  drop_outliers(solved, squared_cutoff, options.forbearance, map);
  hold_frame(solved, before, map);
  for (size_t i = 0; i < map->keyframes().size(); ++i) map->update_depths(KeyframeId{i + 1});
}

BundleReport minimize(BundleProblem* problem, const BundleOptions& options, Adjuster adjuster) {
  return adjuster == Adjuster::kOwn ? solve_bundle(problem, options)
                                    : solve_bundle_with_ceres(problem, options, {});
}

BundleReport adjust_locally(MapState* map, KeyframeId newest, const MapMakerOptions& options,
                            const std::function<bool()>& should_stop) {
  MapProblem problem = local_problem(*map, newest, options.local_keyframes);
  BundleOptions bundle;
  bundle.max_iterations = options.local_iterations;
  bundle.function_tolerance = options.adjustment.local_tolerance;
  bundle.should_stop = should_stop;
  const BundleReport report = minimize(&problem.bundle, bundle, options.adjuster);
  if (!report.usable) return report;
  const std::vector<Standing> before = standing_of(*map);
  write_local(problem, map);
  drop_outliers(problem, report.squared_cutoff, options.self_calibration.forbearance, map);
  const bool is_whole = problem.keyframes.size() == map->live_keyframes();
  if (is_whole) hold_frame(problem, before, map);  // else the others do
  for (const KeyframeId id : problem.keyframes) map->update_depths(id);
  return report;
}

BundleReport adjust_whole(MapState* map, const MapMakerOptions& options) {
  MapProblem problem = global_problem(*map, options.self_calibration);
  BundleOptions bundle = global_options(options.adjustment, {});
  bundle.rounds = options.adjustment.start_rounds;
  const BundleReport report = minimize(&problem.bundle, bundle, options.adjuster);
  if (report.usable) write_back(problem, report.squared_cutoff, options.self_calibration, map);
  return report;
}

BundleOptions global_options(const AdjustmentOptions& options, const std::function<bool()>& should_stop) {
  BundleOptions bundle;
  bundle.max_iterations = options.global_iterations;
  bundle.function_tolerance = options.global_tolerance;
  bundle.should_stop = should_stop;
  return bundle;
}

}  // namespace cairn
