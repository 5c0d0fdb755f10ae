// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/new_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "common/base/median.h"
#include "common/geometry/triangulation.h"
#include "server/mapping/epipolar_search.h"

namespace cairn {
namespace {

/// A raster of the pixels that are taken, for thinning in constant time.
class Occupancy {
 public:
  Occupancy(int width, int height)
      : width_(width), height_(height), taken_(static_cast<size_t>(width) * static_cast<size_t>(height), 0) {}

  void take_disc(double x, double y, double radius) {
    const int y0 = std::max(0, static_cast<int>(std::ceil(y - radius)));
    const int y1 = std::min(height_ - 1, static_cast<int>(std::floor(y + radius)));
    for (int j = y0; j <= y1; ++j) {
      const double half = std::sqrt(std::max(0.0, radius * radius - (j - y) * (j - y)));
      const int x0 = std::max(0, static_cast<int>(std::ceil(x - half)));
      const int x1 = std::min(width_ - 1, static_cast<int>(std::floor(x + half)));
      if (x0 <= x1) std::fill_n(taken_.begin() + j * width_ + x0, x1 - x0 + 1, uint8_t{1});
    }
  }
  [[nodiscard]] bool is_taken(Corner c) const { return taken_[static_cast<size_t>(c.y * width_ + c.x)] != 0; }

 private:
  int width_;
  int height_;
  std::vector<uint8_t> taken_;
};

/// Looks for a new point in further keyframes that should see it. confirm() is false if at least two should
/// and none does.
class ConfirmingKeyframes {
 public:
  ConfirmingKeyframes(const MapState& map, const MapKeyframe& keyframe, std::vector<KeyframeId> ids,
                      const TwoViewPointOptions& options)
      : options_(options), ids_(std::move(ids)) {
    for (const KeyframeId id : ids_) {
      keyframes_.push_back(&map.keyframe(id));
      from_source_.push_back(keyframes_.back()->camera_from_map * keyframe.camera_from_map.inverse());
    }
  }

  bool confirm(const PointSource& source, const NewPoint& point, KeyframeId partner,
               std::vector<std::pair<KeyframeId, PatchFound>>* found) const {
    int asked = 0;
    found->clear();
    for (size_t i = 0; i < ids_.size(); ++i) {
      if (ids_[i] == partner) continue;
      const Eigen::Vector3d to_camera = (from_source_[i].center() - point.in_source).normalized();
      if (to_camera.dot(-point.in_source.normalized()) < options_.confirm_cosine) continue;
      const auto view = view_patch(source, point.in_source, from_source_[i], *keyframes_[i]->camera);
      if (!view || !keyframes_[i]->camera->in_image(view->pixel, options_.image_border * (1 << view->level)))
        continue;
      ++asked;
      const auto hit = find_near_corner(source, *view, *keyframes_[i]->images, options_.confirm_radius);
      if (hit) found->emplace_back(ids_[i], *hit);
    }
    return asked < 2 || !found->empty();
  }

 private:
  const TwoViewPointOptions& options_;
  std::vector<KeyframeId> ids_;
  std::vector<const MapKeyframe*> keyframes_;
  std::vector<SE3> from_source_;
};

Occupancy known_measurements(const MapKeyframe& keyframe, int level, double distance) {
  const GrayView image = keyframe.images->level(level);
  Occupancy taken(image.width, image.height);
  for (const Measurement& m : keyframe.measurements) {
    if (m.level != level && m.level != level + 1) continue;
    taken.take_disc(to_level(m.pixel.x(), level), to_level(m.pixel.y(), level), distance);
  }
  return taken;
}

std::vector<Candidate> strongest_first(std::vector<Candidate> candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  return candidates;
}

}  // namespace

std::vector<KeyframeId> rank_partners(const MapState& map, const MapKeyframe& keyframe,
                                      std::span<const Eigen::Vector3d> points, double min_parallax,
                                      size_t count, const TwoViewPointOptions& options) {
  const Eigen::Vector3d center = keyframe.camera_from_map.center();
  std::vector<std::pair<double, KeyframeId>> ranked;
  for (const MapKeyframe& other : map.keyframes()) {
    if (!other.live || other.id == keyframe.id) continue;
    const Eigen::Vector3d other_center = other.camera_from_map.center();
    std::vector<double> angles;
    for (const Eigen::Vector3d& point : points) {
      const auto pixel = other.camera->project(other.camera_from_map * point);
      if (pixel && other.camera->in_image(*pixel)) angles.push_back(parallax(point, center, other_center));
    }
    if (angles.empty()) continue;
    const double angle = reorder_to_median(std::span(angles));
    if (angle < min_parallax) continue;
    const double usefulness = std::min({1.0, angle / options.good_parallax, options.wide_parallax / angle});
    ranked.emplace_back(-usefulness * static_cast<double>(angles.size()), other.id);
  }
  std::sort(ranked.begin(), ranked.end());
  std::vector<KeyframeId> partners;
  for (size_t i = 0; i < std::min(count, ranked.size()); ++i) partners.push_back(ranked[i].second);
  return partners;
}

namespace {

/// The keyframes to search in, best first: those that see much of what `keyframe` sees, at a useful parallax.
std::vector<KeyframeId> choose_partners(const MapState& map, const MapKeyframe& keyframe, double min_parallax,
                                        const TwoViewPointOptions& options) {
  const auto count = static_cast<size_t>(options.partners + options.confirming_keyframes);
  const size_t stride = std::max<size_t>(1, keyframe.measurements.size() / options.overlap_samples);
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < keyframe.measurements.size(); i += stride)
    points.push_back(map.point(keyframe.measurements[i].point).position);
  return rank_partners(map, keyframe, points, min_parallax, count, options);
}

}  // namespace

NewPoints make_new_points(MapState* map, KeyframeId keyframe_id, int level, const NewPointsLimits& limits,
                          const TwoViewPointOptions& options, const std::function<bool()>& should_yield) {
  const MapKeyframe& keyframe = map->keyframe(keyframe_id);
  NewPoints result;
  if (keyframe.near_depth <= 0) return result;
  const SE3 map_from_keyframe = keyframe.camera_from_map.inverse();
  const std::vector<KeyframeId> others = choose_partners(*map, keyframe, limits.min_parallax, options);
  std::vector<EpipolarSearch> searches;
  for (size_t i = 0; i < std::min(others.size(), static_cast<size_t>(options.partners)); ++i) {
    searches.emplace_back(keyframe, map->keyframe(others[i]), limits.min_parallax, options.epipolar);
  }
  const ConfirmingKeyframes confirming(*map, keyframe, others, options);
  Occupancy taken = known_measurements(keyframe, level, options.known_distance);
  std::vector<std::pair<KeyframeId, PatchFound>> seen_by;
  const std::vector<Candidate> candidates =
      strongest_first(point_candidates(*keyframe.images, level, options));
  for (size_t c = limits.first_candidate; c < candidates.size(); ++c) {
    if (static_cast<int>(result.made.size()) >= limits.max_points) break;
    if (c % options.candidates_per_poll == options.candidates_per_poll - 1 && should_yield()) {
      result.next_candidate = c;
      result.finished = false;
      break;
    }
    const Corner corner = candidates[c].corner;
    if (taken.is_taken(corner)) continue;
    const auto source = make_source(keyframe, level, corner);
    if (!source) continue;
    for (size_t i = 0; i < searches.size(); ++i) {
      const auto point = searches[i].find(*source);
      if (!point || !confirming.confirm(*source, *point, others[i], &seen_by)) continue;
      if (limits.extent && !contains(*limits.extent, map_from_keyframe * point->in_source)) break;
      seen_by.emplace_back(others[i], point->found);
      result.made.push_back(add_point(map, *source, point->in_source, seen_by));
      taken.take_disc(corner.x, corner.y, options.new_distance);
      break;
    }
  }
  return result;
}

}  // namespace cairn
