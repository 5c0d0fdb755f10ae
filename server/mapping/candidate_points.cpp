// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/candidate_points.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "common/map/limits.h"
#include "server/mapping/epipolar_search.h"
#include "server/mapping/new_points.h"

namespace cairn {
namespace {

constexpr double kStep = 1e-3;  ///< of the inverse depth, for a derivative: a matter of numbers, no option

/// The inverse of a depth along the axis of the keyframe's camera [1 / map unit].
struct Depth {
  double inverse = 0;
  double variance = 0;
};

bool is_sound(const PointCandidate& c, const Camera& camera) {
  return c.level < kPyramidLevels && c.pixel.allFinite() && camera.in_image(c.pixel.cast<double>()) &&
         std::isfinite(c.inverse_depth) && c.inverse_depth > 0 && std::isfinite(c.sigma) && c.sigma > 0;
}

Eigen::Vector3d point_of(const PointSource& source, double inverse_depth) {
  const Eigen::Vector3d ray = source.ray_center.cast<double>();
  return ray / (ray.z() * inverse_depth);
}

class CandidatePoints {
 public:
  CandidatePoints(MapState* map, KeyframeId keyframe, const MapMakerOptions& options)
      : map_(*map), id_(keyframe), options_(options.candidates), two_views_(options.new_points) {}

  std::vector<PointId> make(std::span<const PointCandidate> candidates, const std::optional<Extent>& extent) {
    const SE3 map_from_camera = keyframe().camera_from_map.inverse();
    take_in(candidates.first(std::min(candidates.size(), kMaxCandidates)));
    std::vector<PointId> made;
    const std::vector<KeyframeId> partners =
        rank_partners(map_, keyframe(), positions_, 0, options_.partners, two_views_);
    std::vector<EpipolarSearch> searches;
    for (const KeyframeId partner : partners)
      searches.emplace_back(keyframe(), map_.keyframe(partner), two_views_.min_parallax, two_views_.epipolar);
    for (const auto& [source, told] : sources_) {
      if (is_taken(source)) continue;
      Depth depth = told;
      const std::optional<Seen> seen = look(source, partners, &searches, &depth);
      if (!seen || std::sqrt(depth.variance) > options_.known_depth * depth.inverse) continue;
      const Eigen::Vector3d in_source = point_of(source, depth.inverse);
      if (extent && !contains(*extent, map_from_camera * in_source)) continue;
      made.push_back(add_point(&map_, source, in_source, *seen));
    }
    return made;
  }

 private:
  using Seen = std::vector<std::pair<KeyframeId, PatchFound>>;

  [[nodiscard]] const MapKeyframe& keyframe() const { return map_.keyframe(id_); }

  void take_in(std::span<const PointCandidate> candidates) {
    const SE3 map_from_camera = keyframe().camera_from_map.inverse();
    for (const PointCandidate& c : candidates) {
      if (!is_sound(c, *keyframe().camera)) continue;
      if (keyframe().still && keyframe().still->covers(c.pixel)) continue;
      const Corner corner{static_cast<int16_t>(std::lround(to_level(c.pixel.x(), c.level))),
                          static_cast<int16_t>(std::lround(to_level(c.pixel.y(), c.level)))};
      const auto source = make_source(keyframe(), c.level, corner);
      if (!source || !(source->ray_center.z() > 0)) continue;
      const double along_axis = source->ray_center.normalized().z();
      const Depth depth{c.inverse_depth / along_axis, std::pow(c.sigma / along_axis, 2)};
      sources_.emplace_back(*source, depth);
      positions_.push_back(map_from_camera * point_of(*source, depth.inverse));
    }
  }

  /// Whether the map has a point there.
  [[nodiscard]] bool is_taken(const PointSource& source) const {
    const float apart = options_.known_distance * static_cast<float>(1 << source.level);
    const Eigen::Vector2f pixel = pixel_of(source);
    return std::any_of(keyframe().measurements.begin(), keyframe().measurements.end(),
                       [&](const Measurement& m) { return (m.pixel - pixel).squaredNorm() < apart * apart; });
  }

  /// Looks for a candidate in the partners that should see it, and corrects `depth` by each that does.
  /// Nothing if some should show it and none does.
  std::optional<Seen> look(const PointSource& source, const std::vector<KeyframeId>& partners,
                           std::vector<EpipolarSearch>* searches, Depth* depth) const {
    Seen seen;
    bool was_asked = false;
    for (size_t i = 0; i < partners.size(); ++i) {
      const MapKeyframe& partner = map_.keyframe(partners[i]);
      EpipolarSearch& search = (*searches)[i];
      if (!should_see(source, *depth, partner, search)) continue;
      was_asked = true;
      const double reach = options_.sigmas * std::sqrt(depth->variance);
      const auto found = search.find_match(
          source,
          {std::max(depth->inverse - reach, options_.least_share * depth->inverse), depth->inverse + reach});
      if (found && measure(source, *found, search, depth)) seen.emplace_back(partners[i], *found);
    }
    if (was_asked && seen.empty()) return std::nullopt;
    return seen;
  }

  [[nodiscard]] bool should_see(const PointSource& source, const Depth& depth, const MapKeyframe& partner,
                                const EpipolarSearch& search) const {
    const auto view = search.view_at(source, depth.inverse);
    if (!view || !partner.camera->in_image(view->pixel, options_.image_border * (1 << view->level)))
      return false;
    const Eigen::Vector3d point = point_of(source, depth.inverse);
    const Eigen::Vector3d center = keyframe().camera_from_map * partner.camera_from_map.center();
    return (center - point).normalized().dot(-point.normalized()) > options_.seen_cosine;
  }

  /// Corrects the inverse depth by one scalar Kalman step. False when what was found is not on the line.
  [[nodiscard]] bool measure(const PointSource& source, const PatchFound& found, const EpipolarSearch& search,
                             Depth* depth) const {
    const double step = kStep * depth->inverse;
    const auto here = search.pixel_at(source, depth->inverse);
    const auto nearer = search.pixel_at(source, depth->inverse + step);
    if (!here || !nearer) return false;
    const Eigen::Vector2d by_depth = (*nearer - *here) / step;
    const Eigen::Vector2d innovation = found.pixel.cast<double>() - *here;
    const double level_pixel = 1 << found.level;
    const double noise = std::pow(options_.measured_sigma * level_pixel, 2);
    const double variance = 1 / (1 / depth->variance + by_depth.squaredNorm() / noise);
    const double inverse = depth->inverse + variance * by_depth.dot(innovation) / noise;
    const auto now = inverse > 0 ? search.pixel_at(source, inverse) : std::nullopt;
    if (!now || (found.pixel.cast<double>() - *now).squaredNorm() >
                    options_.max_squared_residual * level_pixel * level_pixel)
      return false;
    *depth = {inverse, variance};
    return true;
  }

  MapState& map_;
  KeyframeId id_;
  const CandidatePointOptions& options_;
  const TwoViewPointOptions& two_views_;
  std::vector<std::pair<PointSource, Depth>> sources_;
  std::vector<Eigen::Vector3d> positions_;  ///< map frame
};

}  // namespace

std::vector<PointId> make_candidate_points(MapState* map, KeyframeId keyframe,
                                           std::span<const PointCandidate> candidates,
                                           const std::optional<Extent>& extent,
                                           const MapMakerOptions& options) {
  const auto& all = map->keyframes();
  if (candidates.empty() || std::any_of(all.begin(), all.end(), lacks_images)) return {};
  return CandidatePoints(map, keyframe, options).make(candidates, extent);
}

}  // namespace cairn
