// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/match.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

namespace cairn {
namespace {

struct Best {
  uint32_t index = 0;
  int distance = 0;
  int rival = 0;
};

/// Points of a keyframe in a corner's cells, over the scales up to an octave from its own, that may be the
/// corner's or a rival. `near` is replaced.
void find_near(const PlaceCorner& corner, const CellList& cells, const DescribedPoints& exposed,
               const MatchOptions& options, std::vector<NearDescriptor>* near) {
  const size_t from = static_cast<size_t>(std::max(0, 2 * corner.level - 2));
  const size_t to = static_cast<size_t>(std::min(kPlaceScales - 1, 2 * corner.level + 2));
  std::array<IndexRange, kProbedCells> within;
  std::ranges::transform(cells, within.begin(), [&](CellId cell) {
    const uint32_t* begin_of = &exposed.begin_of[cell * size_t{kPlaceScales}];
    return IndexRange{begin_of[from], begin_of[to + 1]};
  });
  near->clear();
  find_nearest_few(corner.descriptor, exposed.descriptors, within, options.max_distance, options.ratio, near);
}

/// Chooses the nearest point and, if it matters, its nearest rival elsewhere; nothing if none is near enough.
/// Map points made of one corner at several scales look alike and are not rivals.
std::optional<Best> choose(std::span<const NearDescriptor> near, const IndexedKeyframe& keyframe,
                           std::span<const DescribedPoint> points, const MatchOptions& options) {
  int least = options.max_distance + 1;
  for (const NearDescriptor& n : near) least = std::min(least, n.distance);
  if (least > options.max_distance) return std::nullopt;
  const int farthest = farthest_within_ratio(least, options.ratio);
  const auto is_rival = [&](uint32_t a, uint32_t b) {
    if (points[a].scale == points[b].scale) return true;
    const Sighting& p = keyframe.sightings[points[a].measured];
    const Sighting& q = keyframe.sightings[points[b].measured];
    const float same_place = options.same_place * static_cast<float>(1 << p.level);
    return (p.pixel - q.pixel).squaredNorm() > same_place * same_place;
  };
  const int too_far = options.max_rival_distance() + 1;
  Best best{0, too_far, too_far};
  for (const NearDescriptor& n : near) {
    if (n.distance > farthest || n.distance >= best.rival) continue;
    const bool rivals = best.distance < too_far && is_rival(n.index, best.index);
    if (n.distance < best.distance) {
      if (rivals) best.rival = best.distance;
      best.distance = n.distance;
      best.index = n.index;
    } else if (rivals) {
      best.rival = n.distance;
    }
  }
  return best;
}

/// Keeps the nearest of the matches that share a point, then of those that share a corner. The result is in
/// the order of corners.
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

/// Prefetches what is spread over memory and will be needed: it is waited for once, in a row, and not piece
/// by piece.
template <typename T>
void prefetch(std::span<const T> items) {
  constexpr size_t kCacheLine = 64;
  const auto bytes = std::as_bytes(items);
  for (size_t i = 0; i < bytes.size(); i += kCacheLine) __builtin_prefetch(&bytes[i]);
}

/// Appends to `matches` those of every second corner, from `first` on; a point may be there twice.
std::vector<PlaceMatch> match_every_second(const PlaceView& view, std::span<const CellList> cells,
                                           const IndexedMap& map, size_t keyframe, size_t first,
                                           std::vector<PlaceMatch> matches, const MatchOptions& options) {
  const IndexedKeyframe& indexed = *map.keyframes[keyframe];
  const DescribedPoints& exposed = indexed.exposed_as(white_share(view.small));
  prefetch<uint32_t>(exposed.begin_of);
  prefetch<Descriptor>(exposed.descriptors);
  prefetch<DescribedPoint>(exposed.points);
  prefetch<Sighting>(indexed.sightings);
  std::vector<NearDescriptor> near;
  for (size_t i = first; i < view.corners.size(); i += 2) {
    find_near(view.corners[i], cells[i], exposed, options, &near);
    const auto best = choose(near, indexed, exposed.points, options);
    if (!best || static_cast<float>(best->distance) > options.ratio * static_cast<float>(best->rival))
      continue;
    const uint32_t point = exposed.points[best->index].measured;
    const Eigen::Vector3f& position = map.positions[keyframe][point];
    if (!position.allFinite()) continue;
    matches.push_back({i, indexed.measured[point], position.cast<double>(), best->distance,
                       indexed.sightings[point].pixel});
  }
  return matches;
}

/// The corners near one projected point, and the search for the one that looks most like it.
class Neighbourhood {
 public:
  Neighbourhood(const CornerGrid& grid, double radius) : grid_(grid), radius_(radius) {}

  void gather(const ProjectedPoints& projected, const ProjectedPoint& point) {
    int lowest = kPyramidLevels - 1;
    int highest = 0;
    for (const KeyframeSighting& s : projected.sightings_of(point)) {
      lowest = std::min<int>(lowest, s.sighting->level);
      highest = std::max<int>(highest, s.sighting->level);
    }
    near_.clear();
    begin_.fill(0);
    for (int level = 0; level < kPyramidLevels; ++level) {
      begin_[static_cast<size_t>(level)] = near_.size();
      if (level + 1 >= lowest && level <= highest + 1)
        grid_.find(point.pixel, level, radius_ * (1 << level), &near_);
    }
    begin_.back() = near_.size();
    descriptors_.clear();
    for (const uint32_t position : near_) descriptors_.push_back(grid_.descriptor(position));
    distances_.resize(near_.size());
  }
  /// Positions in the grid.
  [[nodiscard]] const std::vector<uint32_t>& corners() const { return near_; }
  /// Compares a sighting with the corners at most a level away. Replaces `best` by a corner that is more
  /// alike; ties go to the lower corner.
  void compare(const KeyframeSighting& seen, PlaceMatch* best) {
    const size_t first = begin_[static_cast<size_t>(std::max(seen.sighting->level - 1, 0))];
    const size_t last = begin_[static_cast<size_t>(std::min(seen.sighting->level + 2, kPyramidLevels))];
    const auto within = std::span(descriptors_).subspan(first, last - first);
    for (uint8_t i = 0; i < seen.sighting->descriptions; ++i) {
      descriptor_distances(*seen.descriptors[i], within, distances_.data());
      for (size_t k = 0; k < within.size(); ++k) {
        const size_t corner = grid_.entry(near_[first + k]).corner;
        const int distance = distances_[k];
        if (std::tie(distance, corner) >= std::tie(best->distance, best->corner)) continue;
        best->distance = distance;
        best->corner = corner;
        best->there = seen.sighting->pixel;
      }
    }
  }

 private:
  const CornerGrid& grid_;
  double radius_;
  std::vector<uint32_t> near_;                      ///< by level
  std::array<size_t, kPyramidLevels + 1> begin_{};  ///< of `near_`
  std::vector<Descriptor> descriptors_;             ///< of `near_`
  std::vector<uint16_t> distances_;
};

}  // namespace

std::vector<CellList> probed_cells(const PlaceView& view) {
  std::vector<CellList> cells;
  cells.reserve(view.corners.size());
  for (const PlaceCorner& corner : view.corners) cells.push_back(nearest_cells(corner.descriptor));
  return cells;
}

Prefilter run_prefilter(const PlaceView& view, std::span<const CellList> cells, const IndexedMap& map,
                        size_t keyframe, const MatchOptions& options) {
  Prefilter prefilter{.matches = match_every_second(view, cells, map, keyframe, 0, {}, options)};
  std::vector<PlaceMatch> distinct = prefilter.matches;
  keep_one_to_one(&distinct);
  prefilter.distinct = distinct.size();
  prefilter.supported = keep_supported(view, distinct, options).size();
  return prefilter;
}

std::vector<PlaceMatch> match_closer(const PlaceView& view, std::span<const CellList> cells,
                                     const IndexedMap& map, size_t keyframe, const Prefilter& prefilter,
                                     const MatchOptions& options) {
  std::vector<PlaceMatch> matches =
      match_every_second(view, cells, map, keyframe, 1, prefilter.matches, options);
  keep_one_to_one(&matches);
  return matches;
}

CornerGrid::CornerGrid(const PlaceView& view, const Camera& camera) {
  constexpr double kCell = 8;  // px of the corner's level
  for (int l = 0; l < kPyramidLevels; ++l) {
    Level& level = levels_[static_cast<size_t>(l)];
    level.cell = kCell * (1 << l);
    level.columns = static_cast<int>(camera.width() / level.cell) + 1;
    level.rows = static_cast<int>(camera.height() / level.cell) + 1;
    level.begin.assign(static_cast<size_t>(level.columns) * static_cast<size_t>(level.rows) + 1, 0);
  }
  const auto cell_of = [&](const PlaceCorner& c) {
    const Level& level = levels_[c.level];
    return static_cast<size_t>(level.row_of(static_cast<double>(c.pixel.y())) * level.columns +
                               level.column_of(static_cast<double>(c.pixel.x())));
  };
  for (const PlaceCorner& c : view.corners) ++levels_[c.level].begin[cell_of(c) + 1];
  uint32_t sum = 0;
  for (Level& level : levels_) {
    for (uint32_t& begin : level.begin) begin = sum += begin;
  }
  std::array<std::vector<uint32_t>, kPyramidLevels> next;
  for (size_t l = 0; l < next.size(); ++l) next[l] = levels_[l].begin;
  entries_.resize(view.corners.size());
  descriptors_.resize(view.corners.size());
  for (uint32_t i = 0; i < view.corners.size(); ++i) {
    const PlaceCorner& c = view.corners[i];
    const uint32_t position = next[c.level][cell_of(c)]++;
    entries_[position] = {c.pixel, i};
    descriptors_[position] = c.descriptor;
  }
}

int CornerGrid::Level::column_of(double x) const {
  return static_cast<int>(std::clamp(x / cell, 0.0, static_cast<double>(columns - 1)));
}

int CornerGrid::Level::row_of(double y) const {
  return static_cast<int>(std::clamp(y / cell, 0.0, static_cast<double>(rows - 1)));
}

void CornerGrid::find(const Eigen::Vector2d& pixel, int level, double radius,
                      std::vector<uint32_t>* out) const {
  const Level& cells = levels_[static_cast<size_t>(level)];
  const int left = cells.column_of(pixel.x() - radius);
  const int right = cells.column_of(pixel.x() + radius);
  const int bottom = cells.row_of(pixel.y() + radius);
  for (int row = cells.row_of(pixel.y() - radius); row <= bottom; ++row) {
    const uint32_t* begin = &cells.begin[static_cast<size_t>(row * cells.columns)];
    for (uint32_t i = begin[left]; i < begin[right + 1]; ++i) {
      if ((entries_[i].pixel.cast<double>() - pixel).squaredNorm() <= radius * radius) out->push_back(i);
    }
  }
}

void project_points(const Camera& camera, const SE3& camera_from_map, const IndexedMap& map,
                    std::span<const size_t> keyframes, float white, ProjectedPoints* out, size_t every) {
  out->points.clear();
  out->sightings.clear();
  const Eigen::Matrix3d rotation = camera_from_map.rotation_matrix();
  constexpr PointId kNone{std::numeric_limits<uint64_t>::max()};
  std::vector<size_t> next(keyframes.size());
  for (size_t passed = 0;; ++passed) {
    // All keyframes go through their points together, in the order of ids.
    PointId id = kNone;
    for (size_t i = 0; i < keyframes.size(); ++i) {
      const std::vector<PointId>& measured = map.keyframes[keyframes[i]]->measured;
      if (next[i] < measured.size()) id = std::min(id, measured[next[i]]);
    }
    if (id == kNone) return;
    const bool is_left_out = passed % every != 0;
    const auto first_sighting = static_cast<uint32_t>(out->sightings.size());
    const Eigen::Vector3f* position = nullptr;
    for (size_t i = 0; i < keyframes.size(); ++i) {
      const IndexedKeyframe& keyframe = *map.keyframes[keyframes[i]];
      if (next[i] == keyframe.measured.size() || keyframe.measured[next[i]] != id) continue;
      const size_t measured = next[i]++;
      if (is_left_out) continue;
      position = &map.positions[keyframes[i]][measured];
      const Sighting& sighting = keyframe.sightings[measured];
      if (sighting.descriptions == 0) continue;
      const DescribedPoints& exposed = keyframe.exposed_as(white);
      const auto& described = exposed.of_measured[measured];
      out->sightings.push_back(
          {&sighting, {&exposed.descriptors[described[0]], &exposed.descriptors[described[1]]}});
    }
    const auto count = static_cast<uint32_t>(out->sightings.size()) - first_sighting;
    if (count == 0) continue;
    const Eigen::Vector3d point = position->cast<double>();
    const Eigen::Vector3d seen = rotation * point + camera_from_map.translation();
    const auto pixel = position->allFinite() ? camera.project(seen) : std::nullopt;
    if (pixel && camera.in_image(*pixel)) {
      out->points.push_back({id, point, *pixel, seen.z(), first_sighting, count});
    } else {
      out->sightings.resize(first_sighting);
    }
  }
}

GuidedMatches match_near(const PlaceView& view, const CornerGrid& grid, const ProjectedPoints& projected,
                         double radius, const MatchOptions& options) {
  Neighbourhood neighbourhood(grid, radius);
  std::vector<bool> met(view.corners.size());
  size_t points_met = 0;
  std::vector<PlaceMatch> of_corner(view.corners.size());
  for (PlaceMatch& m : of_corner) m.distance = options.max_guided_distance + 1;
  for (const ProjectedPoint& p : projected.points) {
    neighbourhood.gather(projected, p);
    if (neighbourhood.corners().empty()) continue;
    ++points_met;
    for (const uint32_t position : neighbourhood.corners()) met[grid.entry(position).corner] = true;
    PlaceMatch best{0, p.id, p.position, options.max_guided_distance + 1, Eigen::Vector2f::Zero()};
    for (const KeyframeSighting& s : projected.sightings_of(p)) neighbourhood.compare(s, &best);
    // Of two points that want a corner the more alike has it, then the lower id, which came first.
    if (best.distance < of_corner[best.corner].distance) of_corner[best.corner] = best;
  }
  GuidedMatches found;
  found.met = std::min(points_met, static_cast<size_t>(std::count(met.begin(), met.end(), true)));
  std::copy_if(of_corner.begin(), of_corner.end(), std::back_inserter(found.matches),
               [&](const PlaceMatch& m) { return m.distance <= options.max_guided_distance; });
  return found;
}

std::vector<PlaceMatch> keep_supported(const PlaceView& view, std::span<const PlaceMatch> matches,
                                       const MatchOptions& options) {
  // Most pairs lie too far apart or moved too differently whatever lies between them: told without a root.
  const float most_change = options.motion_noise + options.motion_change * options.neighbourhood;
  const float neighbourhood = options.neighbourhood;
  const float same_place = options.same_place;
  struct Motion {
    Eigen::Vector2f from;
    Eigen::Vector2f by;
  };
  std::vector<Motion> motions;
  motions.reserve(matches.size());
  for (const PlaceMatch& m : matches) motions.push_back({m.there, view.corners[m.corner].pixel - m.there});
  const auto supports = [&](const Motion& a, const Motion& b) {
    const float change = (a.by - b.by).squaredNorm();
    const float squared = (a.from - b.from).squaredNorm();
    if (change > most_change * most_change || squared > neighbourhood * neighbourhood) return false;
    return squared >= same_place * same_place &&
           std::sqrt(change) <= options.motion_noise + options.motion_change * std::sqrt(squared);
  };
  std::vector<int> supporters(matches.size());
  for (size_t a = 0; a < motions.size(); ++a) {
    for (size_t b = a + 1; b < motions.size(); ++b) {
      if (!supports(motions[a], motions[b])) continue;
      ++supporters[a];
      ++supporters[b];
    }
  }
  std::vector<PlaceMatch> kept;
  for (size_t m = 0; m < matches.size(); ++m) {
    if (supporters[m] >= options.fewest_supporters) kept.push_back(matches[m]);
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
