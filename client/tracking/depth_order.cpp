// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/depth_order.h"

#include <algorithm>
#include <limits>

namespace cairn {
namespace {

constexpr int kCell = 24;  // [px] level 0
/// A point this many times as deep as its neighbours is behind them. Across two cells a plane turned by 50
/// degrees differs by less, even at the far edge of a view of 50 degrees.
constexpr float kBehind = 1.4F;
constexpr float kNone = std::numeric_limits<float>::infinity();

}  // namespace

void DepthOrder::Cell::add(float depth) {
  if (depth < nearest) {
    second = nearest;
    nearest = depth;
  } else {
    second = std::min(second, depth);
  }
}

DepthOrder::DepthOrder(int width, int height)
    : columns_(width / kCell + 3), cells_(static_cast<size_t>(columns_ * (height / kCell + 3))) {}

size_t DepthOrder::cell_of(const Eigen::Vector2f& pixel) const {
  const int column = std::clamp(static_cast<int>(pixel.x()) / kCell + 1, 1, columns_ - 2);
  const int rows = static_cast<int>(cells_.size()) / columns_;
  const int row = std::clamp(static_cast<int>(pixel.y()) / kCell + 1, 1, rows - 2);
  return static_cast<size_t>(row * columns_ + column);
}

float DepthOrder::front_of(size_t cell) const {
  Cell front{kNone, kNone};
  for (const int row : {-columns_, 0, columns_}) {
    for (const int column : {-1, 0, 1}) {
      const Cell& near = cells_[cell + static_cast<size_t>(row + column)];
      front.add(near.nearest);
      front.add(near.second);
    }
  }
  return front.second;
}

int DepthOrder::count_hidden(std::span<const VisiblePoint> points) {
  std::fill(cells_.begin(), cells_.end(), Cell{kNone, kNone});
  for (const VisiblePoint& p : points) {
    if (p.found) cells_[cell_of(p.expected)].add(p.depth);
  }
  return static_cast<int>(std::count_if(points.begin(), points.end(), [this](const VisiblePoint& p) {
    return p.searched && !p.found && p.depth > kBehind * front_of(cell_of(p.expected));
  }));
}

}  // namespace cairn
