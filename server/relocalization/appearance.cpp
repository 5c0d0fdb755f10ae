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

/// Pearson's correlation of weighted pairs.
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
  /// The correlation; -1 where one of the two values is always the same.
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
                          const ProjectedPoints& projected, float behind) {
  std::vector<Pair> pairs;
  pairs.reserve(projected.sightings.size());
  for (size_t i = 0; i < projected.points.size(); ++i) {
    const ProjectedPoint& p = projected.points[i];
    const Eigen::Vector2f pixel = p.pixel.cast<float>();
    if (order.is_hidden(pixel, static_cast<float>(p.depth), behind)) continue;
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

/// The correlation of local brightness in a cell of the image, and the numbers of sightings and points in it.
struct Cell {
  Correlation local;
  int sightings = 0;
  int points = 0;
  size_t latest_point = 0;
};

/// Whether the cell's correlation is below the limit even if chance has left it too low by so many standard
/// errors (Fisher's z).
bool is_inconsistent(const Cell& cell, const AppearanceOptions& options) {
  constexpr double kMost = 0.999;
  if (cell.points < options.fewest_points) return false;
  const double z = std::atanh(std::clamp(cell.local.value(), -kMost, kMost));
  return std::tanh(z + options.standard_errors / std::sqrt(std::max(1, cell.sightings - 3))) <
         options.inconsistent;
}

int count_inconsistent_cells(std::span<const Pair> pairs, const AppearanceOptions& options) {
  PerCell<Cell> cells{};
  for (const Pair& p : pairs) {
    Cell& cell = cells[p.cell];
    cell.local.add(static_cast<double>(p.there.local), static_cast<double>(p.here.local), p.weight);
    cell.points += cell.points == 0 || cell.latest_point != p.point ? 1 : 0;
    cell.latest_point = p.point;
    ++cell.sightings;
  }
  return static_cast<int>(
      std::ranges::count_if(cells, [&](const Cell& cell) { return is_inconsistent(cell, options); }));
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

Appearance compare_appearance(const PlaceView& view, const Camera& camera, const ProjectedPoints& projected,
                              const AppearanceOptions& options) {
  DepthOrder order(camera.width(), camera.height());
  for (const ProjectedPoint& p : projected.points) {
    for (const KeyframeSighting& s : projected.sightings_of(p)) {
      for (uint8_t i = 0; i < s.sighting->descriptions; ++i)
        order.add(p.pixel.cast<float>(), static_cast<float>(p.depth));
    }
  }
  const std::vector<Pair> pairs = pair_up(view, camera, order, projected, options.behind);
  return {correlate_local(pairs), correlate_order(pairs), count_inconsistent_cells(pairs, options)};
}

}  // namespace cairn
