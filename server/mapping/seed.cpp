// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/seed.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "common/geometry/plane.h"
#include "common/geometry/two_view.h"
#include "common/image/fit_warp.h"
#include "common/map/limits.h"
#include "server/mapping/new_points.h"
#include "server/mapping/patch_view.h"
#include "server/mapping/upright.h"

namespace cairn {
namespace {

constexpr std::array<int, kPyramidLevels> kSeedLevelOrder{0, 3, 1, 2};  // PTAM r114

/// A trail as the start uses it: its first end is on a whole pixel, where the patch is cut.
struct SeedMatch {
  TrailId trail;
  Corner corner;
  PixelMatch match;
};

Corner to_corner(const Eigen::Vector2f& pixel) {
  return {static_cast<int16_t>(std::lround(pixel.x())), static_cast<int16_t>(std::lround(pixel.y()))};
}

Status check_input(const SeedInput& input) {
  if (!input.camera || !input.first_image || !input.second_image) {
    return fail(ErrorCode::kDamaged, "a camera or an image is missing");
  }
  for (const GrayImagePtr& image : {input.first_image, input.second_image}) {
    if (image->width() != input.camera->width() || image->height() != input.camera->height()) {
      return fail(ErrorCode::kDamaged, "image size is not the camera's");
    }
  }
  if (!(std::abs(input.second_from_first.translation().norm() - 1) <= kUnitTolerance)) {
    return fail(ErrorCode::kDamaged, "the motion between the views is not of length 1");
  }
  return {};
}

Warp warp_of(const Camera& camera, const std::vector<Trail>& trails) {
  std::vector<PixelMatch> ends;
  ends.reserve(trails.size());
  for (const Trail& t : trails) {
    const PixelMatch m{t.first.cast<double>(), t.second.cast<double>()};
    if (camera.in_image(m.a) && camera.in_image(m.b)) ends.push_back(m);
  }
  return fit_warp(ends);
}

/// Trails that lie in both images; their second ends are refined to sub-pixel where the patch is still like
/// itself.
std::vector<SeedMatch> usable_trails(const SeedInput& input, const MapKeyframe& first,
                                     const MapKeyframe& second, float trail_shift) {
  PatchView view;
  view.warp = warp_of(*input.camera, input.trails);
  std::vector<SeedMatch> matches;
  for (const Trail& trail : input.trails) {
    const Eigen::Vector2d a = trail.first.cast<double>();
    const Eigen::Vector2d b = trail.second.cast<double>();
    if (!a.allFinite() || !b.allFinite() || !input.camera->in_image(a) || !input.camera->in_image(b))
      continue;
    if (input.still && (input.still->covers(trail.first) || input.still->covers(trail.second))) continue;
    SeedMatch m{trail.id, to_corner(trail.first), {a, b}};
    const auto source = make_source(first, 0, m.corner);
    if (!source) continue;
    const Eigen::Vector2f from_corner = Eigen::Vector2f(m.corner.x, m.corner.y) - trail.first;
    const auto refined =
        refine_from(*source, view, *second.images, trail.second + view.warp * from_corner, trail_shift);
    if (refined) m.match = {{m.corner.x, m.corner.y}, refined->pixel.cast<double>()};
    matches.push_back(m);
  }
  return matches;
}

/// Adds a point for each inlier whose patch is found where the geometry puts it.
void add_trail_points(const std::vector<SeedMatch>& matches, const TwoViewGeometry& geometry, double baseline,
                      KeyframeId first, KeyframeId second, float trail_shift, SeededMap* seeded) {
  MapState& map = seeded->map;
  const MapKeyframe& b = map.keyframe(second);
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!geometry.inlier[i]) continue;
    const auto source = make_source(map.keyframe(first), 0, matches[i].corner);
    if (!source) continue;
    const Eigen::Vector3d point = geometry.points[i] * baseline;
    const auto view = view_patch(*source, point, b.camera_from_map, *b.camera);
    if (!view) continue;
    const auto found = refine_from(*source, *view, *b.images, matches[i].match.b.cast<float>(), trail_shift);
    if (!found) continue;
    const PointId id = map.add_point(*source, point);
    const Eigen::Vector2f corner(matches[i].corner.x, matches[i].corner.y);
    map.add_measurement(first, {id, 0, corner});
    map.add_measurement(second, {id, found->level, found->pixel});
    seeded->result.points.emplace_back(matches[i].trail, id);
  }
}

/// Root mean square of whitened residuals over all measurements.
double whitened_rms(const MapState& map, const SelfCalibrationOptions& options) {
  const BundleProblem problem = global_problem(map, options).bundle;
  double sum = 0;
  for (const BundleObservation& o : problem.observations) sum += squared_residual(problem, o);
  return std::sqrt(sum / std::max<double>(1.0, static_cast<double>(problem.observations.size())));
}

void scale_baseline(MapState* map, KeyframeId first, KeyframeId second, double baseline) {
  const Eigen::Vector3d a = map->keyframe(first).camera_from_map.center();
  const double scale = baseline / (map->keyframe(second).camera_from_map.center() - a).norm();
  map->transform({scale, Eigen::Quaterniond::Identity(), a * (1 - scale)});
}

bool align_plane(MapState* map, KeyframeId first, const MapMakerOptions& options) {
  std::vector<Eigen::Vector3d> points;
  for (const MapPoint& p : map->points()) {
    if (p.live) points.push_back(p.position);
  }
  const MapKeyframe& k = map->keyframe(first);
  const auto fit =
      fit_dominant_plane(points, k.camera_from_map.center(), options.start.plane_distance * k.mean_depth,
                         options.start.plane_trials, options.seed);
  if (fit) map->transform(Similarity3(fit->plane_from_map));
  return fit.has_value();
}

void update_all_depths(MapState* map) {
  for (size_t i = 0; i < map->keyframes().size(); ++i) map->update_depths(KeyframeId{i + 1});
}

MapKeyframe make_keyframe(const SeedInput& input, int estimated_camera, const GrayImage& image,
                          Timestamp time) {
  MapKeyframe k;
  k.camera = input.camera;
  k.estimated_camera = estimated_camera;
  k.time = time;
  k.still = input.still;
  k.images = prepare_images(image.view(), k.still);
  return k;
}

tl::unexpected<Error> too_few(size_t points, size_t needed) {
  return fail(ErrorCode::kDegenerate, "too few points: " + std::to_string(points) +
                                          " of the trails make a point, " + std::to_string(needed) +
                                          " needed");
}

/// The two keyframes, without poses and points yet.
void add_keyframes(const SeedInput& input, SeededMap* seeded) {
  MapState& map = seeded->map;
  const int camera = input.prior ? map.add_camera(input.camera, *input.prior) : -1;
  SeedResult& result = seeded->result;
  result.first_keyframe =
      map.add_keyframe(make_keyframe(input, camera, *input.first_image, input.first_time));
  result.second_keyframe =
      map.add_keyframe(make_keyframe(input, camera, *input.second_image, input.second_time));
  map.keyframe(result.second_keyframe).reference = result.first_keyframe;
  map.keyframe(result.second_keyframe).up = input.second_up;
}

/// Triangulates the matches by the tracker's motion, or says why it does not hold for them.
Result<TwoViewGeometry> check_motion(const SeedInput& input, const std::vector<SeedMatch>& trails,
                                     const StartOptions& options) {
  std::vector<PixelMatch> matches;
  matches.reserve(trails.size());
  for (const SeedMatch& m : trails) matches.push_back(m.match);
  if (matches.size() < options.min_points) return too_few(matches.size(), options.min_points);
  TwoViewCriteria criteria;
  criteria.min_median_parallax = options.parallax_tolerance * kLeastMapParallax;
  auto geometry = build_two_view(*input.camera, *input.camera, matches, input.second_from_first, criteria);
  if (!geometry) return fail(ErrorCode::kDegenerate, geometry.error().message);
  return *std::move(geometry);
}

Status adjust(MapState* map, const MapMakerOptions& options) {
  if (adjust_whole(map, options).usable) return {};
  return fail(ErrorCode::kDegenerate, "the two views do not adjust");
}

/// Measures the trails anew; sets the second keyframe's pose, makes a point for each trail that agrees, and
/// adjusts them. Returns their median parallax [rad].
Result<double> measure_trails(const SeedInput& input, const MapMakerOptions& options, SeededMap* seeded) {
  MapState& map = seeded->map;
  const KeyframeId first = seeded->result.first_keyframe;
  const KeyframeId second = seeded->result.second_keyframe;
  const std::vector<SeedMatch> trails =
      usable_trails(input, map.keyframe(first), map.keyframe(second), options.start.trail_shift);
  const auto geometry = check_motion(input, trails, options.start);
  if (!geometry) return tl::unexpected(geometry.error());
  map.keyframe(second).camera_from_map =
      SE3(geometry->b_from_a.rotation(), geometry->b_from_a.translation() * options.baseline);
  add_trail_points(trails, *geometry, options.baseline, first, second, options.start.trail_shift, seeded);
  if (seeded->result.points.size() < options.start.min_points)
    return too_few(seeded->result.points.size(), options.start.min_points);
  update_all_depths(&map);
  if (auto status = adjust(&map, options); !status) return tl::unexpected(status.error());
  return geometry->median_parallax;
}

/// Makes more points by epipolar search, then checks that all of them fit the two views. Where the pair has
/// little parallax they may have less, too: without points of the large levels, a tracker finds half of the
/// map.
Status fill_in_points(const MapMakerOptions& options, double median_parallax, SeededMap* seeded) {
  MapState& map = seeded->map;
  NewPointsLimits new_points;
  new_points.min_parallax = options.new_points.min_parallax;
  new_points.max_points = options.max_points_per_keyframe / 2;
  if (median_parallax < TwoViewCriteria{}.min_median_parallax)
    new_points.min_parallax =
        std::min(new_points.min_parallax, options.start.share_of_parallax * median_parallax);
  for (const int level : kSeedLevelOrder) {
    (void)make_new_points(&map, seeded->result.second_keyframe, level, new_points, options.new_points,
                          [] { return false; });
  }
  if (auto status = adjust(&map, options); !status) return status;
  if (map.live_points() < options.start.min_points)
    return too_few(map.live_points(), options.start.min_points);
  if (const double rms = whitened_rms(map, options.self_calibration); rms > options.start.max_rms) {
    return fail(ErrorCode::kDegenerate,
                fmt::format("the two views do not fit: {:.1f} sigma after adjustment, at most {:.1f} allowed",
                            rms, options.start.max_rms));
  }
  return {};
}

Status keep_within(const Extent& extent, size_t min_points, MapState* map) {
  for (const MapKeyframe& k : map->keyframes()) {
    if (const Eigen::Vector3d center = k.camera_from_map.center(); !contains(extent, center))
      return fail(ErrorCode::kRefused, outside(extent, "its camera", center));
  }
  for (const PointId id : std::vector<PointId>(map->live_point_ids())) {
    if (!contains(extent, map->point(id).position)) map->remove_point(id);
  }
  if (map->live_points() >= min_points) {
    update_all_depths(map);
    return {};
  }
  return fail(ErrorCode::kRefused,
              fmt::format("{} of its points are where this client may let the map grow, {}; "
                          "{} are needed",
                          map->live_points(), describe(extent), min_points));
}

}  // namespace

Result<SeededMap> seed_map(const SeedInput& input, const MapMakerOptions& options) {
  if (auto status = check_input(input); !status) return tl::unexpected(status.error());
  SeededMap seeded;
  add_keyframes(input, &seeded);
  const auto parallax = measure_trails(input, options, &seeded);
  if (!parallax) return tl::unexpected(parallax.error());
  if (auto status = fill_in_points(options, *parallax, &seeded); !status)
    return tl::unexpected(status.error());

  MapState& map = seeded.map;
  SeedResult& result = seeded.result;
  scale_baseline(&map, result.first_keyframe, result.second_keyframe, options.baseline);
  result.plane_aligned = align_plane(&map, result.first_keyframe, options);
  if (!result.plane_aligned) stand_upright(result.second_keyframe, &map);
  update_all_depths(&map);
  if (input.extent) {
    if (auto status = keep_within(*input.extent, options.start.min_points, &map); !status)
      return tl::unexpected(status.error());
  }
  std::erase_if(result.points, [&map](const auto& p) { return !map.is_live(p.second); });
  return seeded;
}

}  // namespace cairn
