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

constexpr size_t kBatch = 64;  ///< distances calculated at once

struct Best {
  int index = -1;
  int distance = 257;
  int rival = 257;
};

/// The best in the corner's cells over the scales up to an octave from its own. Map points made of one corner
/// at several scales look alike and are not rivals.
Best find_best(const PlaceCorner& corner, const CellList& cells, const IndexedKeyframe& keyframe) {
  Best best;
  const size_t from = static_cast<size_t>(std::max(0, 2 * corner.level - 2));
  const size_t to = static_cast<size_t>(std::min(kPlaceScales - 1, 2 * corner.level + 2));
  const auto is_rival = [&](size_t a, size_t b) {
    const DescribedPoint& p = keyframe.points[a];
    const DescribedPoint& q = keyframe.points[b];
    return p.scale == q.scale || (p.pixel - q.pixel).norm() > kSamePlace * static_cast<float>(1 << p.level);
  };
  const auto descriptors = std::span(keyframe.descriptors);
  std::array<uint16_t, kBatch> distances;
  const auto consider = [&](size_t begin, size_t end) {
    descriptor_distances(corner.descriptor, descriptors.subspan(begin, end - begin), distances.data());
    for (size_t i = begin; i < end; ++i) {
      const int distance = distances[i - begin];
      if (distance >= best.rival) continue;
      const bool rivals = best.index >= 0 && is_rival(i, static_cast<size_t>(best.index));
      if (distance < best.distance) {
        if (rivals) best.rival = best.distance;
        best.distance = distance;
        best.index = static_cast<int>(i);
      } else if (rivals) {
        best.rival = distance;
      }
    }
  };
  for (const CellId cell : cells) {
    const uint32_t* begin_of = &keyframe.begin_of[cell * size_t{kPlaceScales}];
    const size_t end = begin_of[to + 1];
    for (size_t i = begin_of[from]; i < end; i += kBatch) consider(i, std::min(end, i + kBatch));
  }
  return best;
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

std::vector<CellList> probed_cells(const PlaceView& view) {
  std::vector<CellList> cells;
  cells.reserve(view.corners.size());
  for (const PlaceCorner& corner : view.corners) cells.push_back(nearest_cells(corner.descriptor));
  return cells;
}

std::vector<PlaceMatch> match_anywhere(const PlaceView& view, std::span<const CellList> cells,
                                       const IndexedMap& map, size_t keyframe) {
  const IndexedKeyframe& indexed = *map.keyframes[keyframe];
  std::vector<PlaceMatch> matches;
  for (size_t i = 0; i < view.corners.size(); ++i) {
    const Best best = find_best(view.corners[i], cells[i], indexed);
    if (best.index < 0 || best.distance > kMaxDistance) continue;
    if (static_cast<float>(best.distance) > kRatio * static_cast<float>(best.rival)) continue;
    const DescribedPoint& point = indexed.points[static_cast<size_t>(best.index)];
    const Eigen::Vector3f& position = map.position(keyframe, point);
    if (position.allFinite())
      matches.push_back({i, point.id, position.cast<double>(), best.distance, point.pixel});
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

void project_points(const Camera& camera, const SE3& camera_from_map, const IndexedMap& map,
                    std::span<const size_t> keyframes, std::vector<ProjectedPoint>* out) {
  out->clear();
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  struct Projected {
    Eigen::Vector2d pixel;
    double depth;
  };
  std::vector<std::optional<Projected>> projected;
  for (const size_t k : keyframes) {
    const std::vector<Eigen::Vector3f>& positions = map.positions[k];
    projected.assign(positions.size(), std::nullopt);
    for (size_t i = 0; i < positions.size(); ++i) {
      if (!positions[i].allFinite()) continue;
      const Eigen::Vector3d seen = rotation * positions[i].cast<double>() + camera_from_map.translation();
      const auto pixel = camera.project(seen);
      if (pixel && camera.in_image(*pixel)) projected[i] = Projected{*pixel, seen.z()};
    }
    const IndexedKeyframe& keyframe = *map.keyframes[k];
    for (size_t i = 0; i < keyframe.points.size(); ++i) {
      const uint32_t measured = keyframe.points[i].measured;
      const auto& seen = projected[measured];
      if (seen) out->push_back({&keyframe, i, positions[measured].cast<double>(), seen->pixel, seen->depth});
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
