// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/appearance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "common/geometry/depth_order.h"
#include "server/relocalization/brightness.h"
#include "server/relocalization/image_cells.h"

namespace cairn {
namespace {

/// A point this many times as deep as its neighbours is behind them. Of a plane turned by 50 degrees the far
/// points of a neighbourhood go, too; the others speak for them.
constexpr float kBehind = 1.15F;

/// A cell of the image is inconsistent when the correlation there is below the limit even if it is so many
/// standard errors higher than found: by the sightings, which are not all by themselves, since a point may
/// have four. Both chosen together, on desks that look alike (tests/bench/HISTORY.md).
constexpr double kInconsistent = 0.35;
constexpr double kStandardErrors = 2.5;
constexpr int kFewestPoints = 4;  ///< in a cell that is judged

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
  size_t cell = 0;   ///< of the image
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
            {*here, *there, static_cast<double>(s.sighting->descriptions), image_cell_of(pixel, camera), i});
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

/// What a cell of the image shows.
struct Cell {
  Correlation local;
  int sightings = 0;
  int points = 0;
  size_t latest_point = 0;
};

/// Fisher's z: the correlation as much higher as chance may have left it too low.
bool is_inconsistent(const Cell& cell) {
  constexpr double kMost = 0.999;
  if (cell.points < kFewestPoints) return false;
  const double z = std::atanh(std::clamp(cell.local.value(), -kMost, kMost));
  return std::tanh(z + kStandardErrors / std::sqrt(std::max(1, cell.sightings - 3))) < kInconsistent;
}

int count_inconsistent_cells(std::span<const Pair> pairs) {
  PerCell<Cell> cells{};
  for (const Pair& p : pairs) {
    Cell& cell = cells[p.cell];
    cell.local.add(static_cast<double>(p.there.local), static_cast<double>(p.here.local), p.weight);
    cell.points += cell.points == 0 || cell.latest_point != p.point ? 1 : 0;
    cell.latest_point = p.point;
    ++cell.sightings;
  }
  return static_cast<int>(std::ranges::count_if(cells, is_inconsistent));
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
  return {correlate_local(pairs), correlate_order(pairs), count_inconsistent_cells(pairs)};
}

}  // namespace cairn
