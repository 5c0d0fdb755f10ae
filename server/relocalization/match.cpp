// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/match.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>

namespace cairn {
namespace {

constexpr int kMaxDistance = 70;  ///< of 256, of a match without a pose to guide it
constexpr float kRatio = 0.85F;   ///< of the distance of the best rival (Lowe, IJCV 2004)
constexpr float kSamePlace =
    6;  ///< [px of level 0 times 2^level] nearer is no rival: the same corner, other level
constexpr int kMaxGuidedDistance = 60;
constexpr float kNeighbourhood = 80;    ///< [px] in the keyframe, within which matches are neighbours
constexpr float kMotionNoise = 8;       ///< [px] of a match at a coarse level
constexpr float kMotionChange = 0.25F;  ///< px of motion per px apart: change of scale, roll, slant
constexpr ptrdiff_t kFewestSupporters = 2;

struct Best {
  int index = -1;
  int distance = 257;
  int rival = 257;
};

/// The best over the scales up to an octave from the corner's own. Map points made of one corner at several
/// levels look alike and are not rivals.
Best find_best(const PlaceCorner& corner, const IndexedKeyframe& keyframe) {
  Best best;
  const int from = std::max(0, 2 * corner.level - 2);
  const int to = std::min(kPlaceScales - 1, 2 * corner.level + 2);
  for (int scale = from; scale <= to; ++scale) {
    const size_t begin = keyframe.scale_begin[static_cast<size_t>(scale)];
    const size_t end = keyframe.scale_begin[static_cast<size_t>(scale) + 1];
    const NearestDescriptor nearest =
        find_nearest(corner.descriptor, std::span(keyframe.descriptors).subspan(begin, end - begin));
    if (nearest.index < 0) continue;
    const int index = static_cast<int>(begin) + nearest.index;
    const auto pixel = [&](int i) { return keyframe.points[static_cast<size_t>(i)].pixel; };
    const float near = kSamePlace * static_cast<float>(1 << scale / 2);
    const bool rivals = best.index >= 0 && (pixel(index) - pixel(best.index)).norm() > near;
    if (nearest.distance < best.distance) {
      best.rival = std::min(nearest.second_distance, rivals ? best.distance : best.rival);
      best.distance = nearest.distance;
      best.index = index;
    } else if (rivals) {
      best.rival = std::min(best.rival, nearest.distance);
    }
  }
  return best;
}

std::optional<Eigen::Vector3d> position_of(const MapSnapshot& snapshot, PointId id) {
  const auto slot = snapshot.find(id);
  if (!slot) return std::nullopt;
  return snapshot.point_blocks[static_cast<size_t>(slot->block)]->position(slot->slot);
}

/// Of matches that share a point (then: a corner) the nearest stays. Result in the order of corners.
void keep_one_to_one(std::vector<PlaceMatch>* matches) {
  const auto thin = [&](const auto& key) {
    std::sort(matches->begin(), matches->end(), [&](const PlaceMatch& a, const PlaceMatch& b) {
      return std::tuple(key(a), a.distance, a.corner, a.point) <
             std::tuple(key(b), b.distance, b.corner, b.point);
    });
    const auto end = std::unique(matches->begin(), matches->end(),
                                 [&](const PlaceMatch& a, const PlaceMatch& b) { return key(a) == key(b); });
    matches->erase(end, matches->end());
  };
  thin([](const PlaceMatch& m) { return m.point.value; });
  thin([](const PlaceMatch& m) { return static_cast<uint64_t>(m.corner); });
}

}  // namespace

std::vector<PlaceMatch> match_anywhere(const PlaceView& view, const IndexedKeyframe& keyframe,
                                       const MapSnapshot& snapshot) {
  std::vector<PlaceMatch> matches;
  for (size_t i = 0; i < view.corners.size(); ++i) {
    const Best best = find_best(view.corners[i], keyframe);
    if (best.index < 0 || best.distance > kMaxDistance) continue;
    if (static_cast<float>(best.distance) > kRatio * static_cast<float>(best.rival)) continue;
    const DescribedPoint& point = keyframe.points[static_cast<size_t>(best.index)];
    const auto position = position_of(snapshot, point.id);
    if (position) matches.push_back({i, point.id, *position, best.distance, point.pixel});
  }
  keep_one_to_one(&matches);
  return matches;
}

CornerGrid::CornerGrid(const PlaceView& view, const Camera& camera)
    : view_(&view),
      columns_(camera.width() / kCell + 1),
      rows_(camera.height() / kCell + 1),
      cells_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_)) {
  for (size_t i = 0; i < view.corners.size(); ++i) {
    const Eigen::Vector2f& p = view.corners[i].pixel;
    const int column = std::clamp(static_cast<int>(p.x()) / kCell, 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(p.y()) / kCell, 0, rows_ - 1);
    cells_[static_cast<size_t>(row * columns_ + column)].push_back(i);
  }
}

void CornerGrid::find(const Eigen::Vector2d& pixel, double radius, std::vector<size_t>* out) const {
  out->clear();
  const auto cell = [](double v, int last) {
    return std::clamp(static_cast<int>(std::floor(v / kCell)), 0, last);
  };
  for (int row = cell(pixel.y() - radius, rows_ - 1); row <= cell(pixel.y() + radius, rows_ - 1); ++row) {
    for (int column = cell(pixel.x() - radius, columns_ - 1);
         column <= cell(pixel.x() + radius, columns_ - 1); ++column) {
      for (const size_t i : cells_[static_cast<size_t>(row * columns_ + column)]) {
        if ((view_->corners[i].pixel.cast<double>() - pixel).squaredNorm() <= radius * radius)
          out->push_back(i);
      }
    }
  }
}

void project_points(const Camera& camera, const SE3& camera_from_map, const MapSnapshot& snapshot,
                    std::span<const IndexedKeyframePtr> keyframes, std::vector<ProjectedPoint>* out) {
  out->clear();
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  for (const IndexedKeyframePtr& keyframe : keyframes) {
    for (size_t k = 0; k < keyframe->points.size(); ++k) {
      const auto position = position_of(snapshot, keyframe->points[k].id);
      if (!position) continue;
      const Eigen::Vector3d seen = rotation * *position + camera_from_map.translation();
      const auto pixel = camera.project(seen);
      if (pixel && camera.in_image(*pixel)) out->push_back({keyframe.get(), k, *position, *pixel, seen.z()});
    }
  }
}

GuidedMatches match_near(const PlaceView& view, const CornerGrid& grid,
                         std::span<const ProjectedPoint> points, double radius) {
  GuidedMatches found;
  std::vector<size_t> near;
  std::vector<PointId> projected;
  projected.reserve(points.size());
  std::vector<bool> met(view.corners.size());
  for (const ProjectedPoint& p : points) {
    const DescribedPoint& point = p.keyframe->points[p.index];
    const Descriptor& descriptor = p.keyframe->descriptors[p.index];
    projected.push_back(point.id);
    grid.find(p.pixel, radius * (1 << std::min<int>(point.level + 1, kPyramidLevels - 1)), &near);
    PlaceMatch best{0, point.id, p.position, kMaxGuidedDistance + 1, point.pixel};
    for (const size_t i : near) {
      const PlaceCorner& corner = view.corners[i];
      if (std::abs(corner.level - point.level) > 1) continue;
      const double reach = radius * (1 << corner.level);
      if ((corner.pixel.cast<double>() - p.pixel).squaredNorm() > reach * reach) continue;
      met[i] = true;
      const int distance = descriptor_distance(corner.descriptor, descriptor);
      if (distance >= best.distance) continue;
      best.corner = i;
      best.distance = distance;
    }
    if (best.distance <= kMaxGuidedDistance) found.matches.push_back(best);
  }
  keep_one_to_one(&found.matches);
  std::sort(projected.begin(), projected.end());
  found.met = static_cast<size_t>(std::count(met.begin(), met.end(), true));
  found.expected = static_cast<size_t>(std::unique(projected.begin(), projected.end()) - projected.begin());
  return found;
}

std::vector<PlaceMatch> keep_supported(const PlaceView& view, std::span<const PlaceMatch> matches) {
  const auto motion = [&](const PlaceMatch& m) -> Eigen::Vector2f {
    return view.corners[m.corner].pixel - m.there;
  };
  const auto supports = [&](const PlaceMatch& a, const PlaceMatch& b) {
    const float apart = (a.there - b.there).norm();
    return apart >= kSamePlace && apart <= kNeighbourhood &&
           (motion(a) - motion(b)).norm() <= kMotionNoise + kMotionChange * apart;
  };
  std::vector<PlaceMatch> kept;
  for (const PlaceMatch& m : matches) {
    const auto supporters =
        std::count_if(matches.begin(), matches.end(), [&](const PlaceMatch& o) { return supports(m, o); });
    if (supporters >= kFewestSupporters) kept.push_back(m);
  }
  return kept;
}

std::vector<PointObservation> to_observations(const PlaceView& view, std::span<const PlaceMatch> matches) {
  std::vector<PointObservation> observations;
  observations.reserve(matches.size());
  for (const PlaceMatch& m : matches) {
    const PlaceCorner& corner = view.corners[m.corner];
    observations.push_back({m.position, corner.pixel.cast<double>(), static_cast<double>(1 << corner.level)});
  }
  return observations;
}

}  // namespace cairn
