// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/integrate.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "common/geometry/pose.h"
#include "common/geometry/scene_depth.h"
#include "common/geometry/view_span.h"
#include "common/image/known_area.h"
#include "server/mapping/patch_view.h"
#include "server/mapping/refind.h"

namespace cairn {
namespace {

struct Judged {
  SE3 camera_from_map;
  size_t measured = 0;  ///< points of the map, inliers or not
  std::vector<PointMeasurement> inliers;
  double mean_depth = 0;
};

KeyframeDecision refuse(KeyframeVerdict verdict, std::string reason) {
  return {verdict, std::move(reason), {}};
}

/// Makes sure that the image is there, decoded where it has to be, and of the camera's size. Error kDamaged,
/// or that of `decode`.
Status take_image(const DecodeImage& decode, KeyframeInput* input) {
  if (!input->image && decode) {
    auto image = decode();
    if (!image) return tl::unexpected(image.error());
    input->image = std::move(*image);
  }
  if (!input->image) return fail(ErrorCode::kDamaged, "the frame has no image");
  return check_image_size(*input->image, *input->camera);
}

/// Optimizes the pose on the measurements of points that still live, each point counted once; returns it with
/// its inliers, or nothing if it is not determined.
std::optional<Judged> reoptimize(const MapState& map, const KeyframeInput& input) {
  std::vector<PointObservation> observations;
  std::vector<PointMeasurement> known;
  std::vector<bool> measured(map.points().size(), false);
  for (const PointMeasurement& m : input.measurements) {
    const bool sound =
        map.is_live(m.id) && m.level < kPyramidLevels && input.camera->in_image(m.pixel.cast<double>());
    if (!sound || measured[m.id.value - 1] || (input.still && input.still->covers(m.pixel))) continue;
    measured[m.id.value - 1] = true;
    known.push_back(m);
    observations.push_back(
        {map.point(m.id).position, m.pixel.cast<double>(), static_cast<double>(1 << m.level)});
  }
  const SE3 start = input.camera_from_reference * map.keyframe(input.reference).camera_from_map;
  const auto estimate = optimize_pose(*input.camera, start, observations);
  if (!estimate || !estimate->camera_from_map.is_finite()) return std::nullopt;
  Judged judged;
  judged.camera_from_map = estimate->camera_from_map;
  judged.measured = known.size();
  std::vector<double> depths;
  for (size_t i = 0; i < known.size(); ++i) {
    if (estimate->weights[i] <= 0) continue;
    judged.inliers.push_back(known[i]);
    depths.push_back((judged.camera_from_map * observations[i].point_in_map).z());
  }
  judged.mean_depth = scene_depth(&depths);
  return judged;
}

/// Nearest camera centres [map unit]: of all keyframes, and of those that look the same way.
struct Nearest {
  double any = std::numeric_limits<double>::infinity();
  double same_direction = std::numeric_limits<double>::infinity();
};

Nearest nearest_keyframes(const MapState& map, const SE3& camera_from_map, double same_direction) {
  Nearest nearest;
  const Eigen::Vector3d center = camera_from_map.center();
  const Eigen::Vector3d axis = camera_from_map.rotation_matrix().row(2);
  for (const MapKeyframe& k : map.keyframes()) {
    if (!k.live) continue;
    const double distance = (k.camera_from_map.center() - center).norm();
    nearest.any = std::min(nearest.any, distance);
    const Eigen::Vector3d other_axis = k.camera_from_map.rotation_matrix().row(2);
    if (axis.dot(other_axis) > same_direction)
      nearest.same_direction = std::min(nearest.same_direction, distance);
  }
  return nearest;
}

/// Whether the frame widens a young map. A map begun with little parallax takes such frames whatever the
/// spacing, since it gets better with each.
bool widens_map(const MapState& map, const SE3& camera_from_map, double mean_depth) {
  std::vector<Eigen::Vector3d> centers;
  for (const MapKeyframe& k : map.keyframes()) {
    if (k.live) centers.push_back(k.camera_from_map.center());
    if (centers.size() > kMostYoungViews) return false;
  }
  return widens_young_map(centers, camera_from_map.center(), mean_depth);
}

double unknown_fraction(const KeyframeImages& images, const std::vector<PointMeasurement>& measured,
                        const MapMakerOptions& options) {
  const int level = options.integration.area_level;
  KnownArea area(images.level(level).width, images.level(level).height);
  for (const Candidate& c : point_candidates(images, level, options.new_points))
    area.add_corner(c.corner.x, c.corner.y);
  for (const PointMeasurement& m : measured)
    area.add_measurement(to_level(m.pixel.x(), level), to_level(m.pixel.y(), level));
  return area.unknown_fraction();
}

/// Adds to `input` measurements of points that the map expects in it: a frame that was tracked while the map
/// could not grow was not measured in what the map has become since. Returns how many points the map expects.
size_t add_what_is_expected(const MapState& map, const std::shared_ptr<const KeyframeImages>& images,
                            const MapMakerOptions& options, KeyframeInput* input) {
  MapKeyframe frame;
  frame.camera = input->camera;
  frame.camera_from_map = input->camera_from_reference * map.keyframe(input->reference).camera_from_map;
  frame.images = images;
  size_t expected = 0;
  for (const PointId id : map.live_point_ids()) {
    const MapPoint& point = map.point(id);
    if (!should_see(map, point, frame.camera_from_map.center(), options.refind.visible_cosine)) continue;
    const auto view = view_point(map, point, frame);
    if (!view) continue;
    ++expected;
    const auto found =
        find_near_corner(*point.source, *view, *frame.images, options.integration.chained_radius);
    if (found) input->measurements.push_back({id, found->level, found->pixel});
  }
  return expected;
}

std::string describe_distance(double distance, double needed) {
  char text[96];
  std::snprintf(text, sizeof(text), "%.3f from the nearest keyframe, %.3f needed at this depth", distance,
                needed);
  return text;
}

/// Refuses a frame outside of its extent, or so near to others that it would show nothing new. `images` are
/// made for the second test if they are not there.
std::optional<KeyframeDecision> refuse_for_its_place(const MapState& map, const KeyframeInput& input,
                                                     const Judged& judged, const KeyframeSpacing& spacing,
                                                     const MapMakerOptions& all,
                                                     std::shared_ptr<const KeyframeImages>* images) {
  const IntegrationOptions& options = all.integration;
  const Eigen::Vector3d center = judged.camera_from_map.center();
  if (input.extent && !contains(*input.extent, center))
    return refuse(KeyframeVerdict::kOutside, outside(*input.extent, "its camera", center));
  const double needed = spacing.min_distance_over_depth * judged.mean_depth;
  const Nearest nearest = nearest_keyframes(map, judged.camera_from_map, options.same_direction);
  const bool widens = widens_map(map, judged.camera_from_map, judged.mean_depth);
  if (!widens && nearest.any < options.new_area_distance * needed)
    return refuse(KeyframeVerdict::kTooClose,
                  describe_distance(nearest.any, options.new_area_distance * needed));
  if (!*images) *images = prepare_images(input.image->view(), input.still);
  const bool knows_little =
      static_cast<double>(judged.inliers.size()) <
      options.few_known * static_cast<double>(map.keyframe(input.reference).measurements.size());
  if (!widens && nearest.same_direction < needed && !knows_little &&
      unknown_fraction(**images, judged.inliers, all) < KnownArea::kNewAreaFraction)
    return refuse(KeyframeVerdict::kTooClose, describe_distance(nearest.same_direction, needed));
  return std::nullopt;
}

/// The measurements that the keyframe's own image bears out: it shows what the map has there. The tracker
/// measures to a pixel where that is enough for it; here they are refined.
std::vector<Measurement> shown_measurements(const MapState& map, const MapKeyframe& keyframe,
                                            const std::vector<PointMeasurement>& measurements,
                                            float max_refinement) {
  std::vector<Measurement> shown;
  for (const PointMeasurement& m : measurements) {
    const MapPoint& point = map.point(m.id);
    const auto view = view_point(map, point, keyframe);
    if (!view) continue;
    const auto found = refine_from(*point.source, *view, *keyframe.images, m.pixel, max_refinement);
    if (found) shown.push_back({m.id, found->level, found->pixel});
  }
  return shown;
}

/// Reason for refusing a frame whose image does not show the points. That measurements agree with a robust
/// pose proves nothing, since it scales its residuals by their own scatter: half of any set "agree" with some
/// pose. Nor does their distance from where the map projects the points, while a camera is being calibrated.
/// What the image shows does.
std::string not_of_this_map(size_t shown, size_t measured, size_t needed) {
  return "its image shows " + std::to_string(shown) + " of the " + std::to_string(measured) +
         " points of the map that were measured in it, " + std::to_string(needed) +
         " needed: it was measured in another map, or in another state of this one";
}

KeyframeDecision too_few_points(const std::optional<Judged>& judged, size_t needed) {
  return refuse(KeyframeVerdict::kTooFewPoints, std::to_string(judged ? judged->inliers.size() : 0) +
                                                    " good measurements of map points, " +
                                                    std::to_string(needed) + " needed");
}

bool has_enough_points(const std::optional<Judged>& judged, size_t needed) {
  return judged && judged->inliers.size() >= needed;
}

KeyframeDecision damaged(const Status& image) {
  return refuse(KeyframeVerdict::kDamaged, image.error().message);
}

void add_measurements(MapState* map, KeyframeId id, const std::vector<Measurement>& measurements) {
  for (const Measurement& m : measurements) {
    MapPoint& point = map->point(m.point);
    ++point.attempts;
    ++point.found;
    map->add_measurement(id, m);
  }
}

/// Optimizes a keyframe's pose on its refined measurements: new points are triangulated from it before any
/// adjustment.
void polish_pose(MapState* map, KeyframeId id) {
  MapKeyframe& keyframe = map->keyframe(id);
  std::vector<PointObservation> observations;
  observations.reserve(keyframe.measurements.size());
  for (const Measurement& m : keyframe.measurements) {
    observations.push_back({map->point(m.point).position, m.pixel.cast<double>(), 1.0 / m.inverse_sigma()});
  }
  const auto estimate = optimize_pose(*keyframe.camera, keyframe.camera_from_map, observations);
  if (estimate && estimate->camera_from_map.is_finite()) keyframe.camera_from_map = estimate->camera_from_map;
}

}  // namespace

KeyframeSpacing keyframe_spacing(const MapMakerOptions& options, double first_mean_depth) {
  const IntegrationOptions& limits = options.integration;
  return {options.min_keyframe_distance *
          std::clamp(options.baseline / first_mean_depth, limits.least_spacing, limits.most_spacing)};
}

KeyframeDecision integrate_keyframe(MapState* map, const KeyframeInput& offered,
                                    const KeyframeSpacing& spacing, const DecodeImage& decode,
                                    const MapMakerOptions& options) {
  const IntegrationOptions& limits = options.integration;
  KeyframeInput input = offered;
  if (!input.camera || !input.camera_from_reference.is_finite())
    return refuse(KeyframeVerdict::kDamaged, "camera or pose do not make a frame");
  if (!map->is_live(input.reference))
    return refuse(KeyframeVerdict::kStale, "the keyframe that its pose refers to is not in the map any more");
  std::shared_ptr<const KeyframeImages> images;
  size_t expected = 0;
  if (input.is_chained) {  // its image shows more points than were measured
    if (Status taken = take_image(decode, &input); !taken) return damaged(taken);
    images = prepare_images(input.image->view(), input.still);
    expected = add_what_is_expected(*map, images, options, &input);
  }
  const auto judged = reoptimize(*map, input);
  if (!has_enough_points(judged, limits.min_measurements))
    return too_few_points(judged, limits.min_measurements);
  if (Status taken = take_image(decode, &input); !taken) return damaged(taken);
  if (static_cast<double>(judged->inliers.size()) < limits.chained_share * static_cast<double>(expected)) {
    return refuse(KeyframeVerdict::kTooFewPoints, std::to_string(judged->inliers.size()) + " of the " +
                                                      std::to_string(expected) +
                                                      " points that the map expects in it were found");
  }
  if (auto refused = refuse_for_its_place(*map, input, *judged, spacing, options, &images))
    return std::move(*refused);

  MapKeyframe keyframe;
  keyframe.reference = input.reference;
  keyframe.camera = input.camera;
  keyframe.time = input.time;
  keyframe.camera_from_map = judged->camera_from_map;
  keyframe.still = input.still;
  keyframe.adds_only = input.adds_only;
  keyframe.up = input.up;
  keyframe.images = std::move(images);
  keyframe.mean_depth = judged->mean_depth;
  const std::vector<Measurement> shown =
      shown_measurements(*map, keyframe, judged->inliers, limits.max_refinement);
  if (shown.size() < limits.min_measurements)
    return refuse(KeyframeVerdict::kTooFewPoints,
                  not_of_this_map(shown.size(), judged->measured, limits.min_measurements));
  const KeyframeId id = map->add_keyframe(std::move(keyframe));
  add_measurements(map, id, shown);
  refind_all(map, id, options.refind);
  polish_pose(map, id);
  map->update_depths(id);
  return {KeyframeVerdict::kAccepted, {}, id};
}

}  // namespace cairn
