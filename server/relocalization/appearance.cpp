// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/appearance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "common/geometry/depth_order.h"
#include "server/relocalization/brightness.h"
#include "server/relocalization/picture_parts.h"

namespace cairn {
namespace {

/// A point this many times as deep as its neighbours is behind them. Of a plane turned by 50 degrees the far
/// points of a neighbourhood go, too; the others speak for them.
constexpr float kBehind = 1.15F;

/// A part of the picture is strange when the correlation there is below the limit even if it is so many
/// standard errors higher than found: by the sightings, which are not all by themselves, since a point may
/// have four. Both chosen together, on desks that look alike (tests/bench/HISTORY.md).
constexpr double kStrange = 0.35;
constexpr double kStandardErrors = 2.5;
constexpr int kFewestPoints = 4;  ///< in a part that is judged

/// Pearson's, of pairs.
class Correlation {
 public:
  void add(double x, double y, double weight) {
    n_ += weight;
    x_ += weight * x;
    y_ += weight * y;
    xx_ += weight * x * x;
    yy_ += weight * y * y;
    xy_ += weight * x * y;
  }
  /// -1 where one of them is always the same.
  [[nodiscard]] double value() const {
    const double variances = (n_ * xx_ - x_ * x_) * (n_ * yy_ - y_ * y_);
    return variances > 0 ? (n_ * xy_ - x_ * y_) / std::sqrt(variances) : -1;
  }

 private:
  double n_ = 0;
  double x_ = 0;
  double y_ = 0;
  double xx_ = 0;
  double yy_ = 0;
  double xy_ = 0;
};

using Levels = std::array<double, 256>;

/// Rank of each grey level among weights by level; those of one level share their mean rank.
Levels rank_levels(const Levels& weights) {
  Levels ranks{};
  double below = 0;
  for (size_t level = 0; level < weights.size(); ++level) {
    ranks[level] = below + 0.5 * weights[level];
    below += weights[level];
  }
  return ranks;
}

/// A point's brightness here, in the query, and there, in a keyframe.
struct Pair {
  Brightness here;
  Brightness there;
  double weight = 0;
  size_t part = 0;   ///< of the picture
  size_t point = 0;  ///< index of the point
};

std::vector<Pair> pair_up(const PlaceView& view, const Camera& camera, const DepthOrder& order,
                          const ProjectedPoints& projected) {
  std::vector<Pair> pairs;
  pairs.reserve(projected.sightings.size());
  for (size_t i = 0; i < projected.points.size(); ++i) {
    const ProjectedPoint& p = projected.points[i];
    const Eigen::Vector2f pixel = p.pixel.cast<float>();
    if (order.is_hidden(pixel, static_cast<float>(p.depth), kBehind)) continue;
    const auto here = brightness_at(view.small, pixel);
    if (!here) continue;
    for (const KeyframeSighting& s : projected.sightings_of(p)) {
      const auto& there = s.sighting->brightness;
      if (there)
        pairs.push_back(
            {*here, *there, static_cast<double>(s.sighting->descriptions), part_of(pixel, camera), i});
    }
  }
  return pairs;
}

double correlate_local(std::span<const Pair> pairs) {
  Correlation correlation;
  for (const Pair& p : pairs)
    correlation.add(static_cast<double>(p.there.local), static_cast<double>(p.here.local), p.weight);
  return correlation.value();
}

/// What a part of the picture shows.
struct Part {
  Correlation local;
  int sightings = 0;
  int points = 0;
  size_t latest_point = 0;
};

/// Fisher's z: the correlation as much higher as chance may have left it too low.
bool is_strange(const Part& part) {
  constexpr double kMost = 0.999;
  if (part.points < kFewestPoints) return false;
  const double z = std::atanh(std::clamp(part.local.value(), -kMost, kMost));
  return std::tanh(z + kStandardErrors / std::sqrt(std::max(1, part.sightings - 3))) < kStrange;
}

int count_strange_parts(std::span<const Pair> pairs) {
  PerPart<Part> parts{};
  for (const Pair& p : pairs) {
    Part& part = parts[p.part];
    part.local.add(static_cast<double>(p.there.local), static_cast<double>(p.here.local), p.weight);
    part.points += part.points == 0 || part.latest_point != p.point ? 1 : 0;
    part.latest_point = p.point;
    ++part.sightings;
  }
  return static_cast<int>(std::ranges::count_if(parts, is_strange));
}

double correlate_order(std::span<const Pair> pairs) {
  Levels here{};
  Levels there{};
  for (const Pair& p : pairs) {
    here[p.here.grey] += p.weight;
    there[p.there.grey] += p.weight;
  }
  const Levels ranks_here = rank_levels(here);
  const Levels ranks_there = rank_levels(there);
  Correlation correlation;
  for (const Pair& p : pairs) correlation.add(ranks_there[p.there.grey], ranks_here[p.here.grey], p.weight);
  return correlation.value();
}

}  // namespace

Appearance compare_appearance(const PlaceView& view, const Camera& camera, const ProjectedPoints& projected) {
  DepthOrder order(camera.width(), camera.height());
  for (const ProjectedPoint& p : projected.points) {
    for (const KeyframeSighting& s : projected.sightings_of(p)) {
      for (uint8_t i = 0; i < s.sighting->descriptions; ++i)
        order.add(p.pixel.cast<float>(), static_cast<float>(p.depth));
    }
  }
  const std::vector<Pair> pairs = pair_up(view, camera, order, projected);
  return {correlate_local(pairs), correlate_order(pairs), count_strange_parts(pairs)};
}

}  // namespace cairn
