// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/depth_order.h"

#include <algorithm>
#include <limits>

namespace cairn {
namespace {

constexpr int kCell = 16;  // [px] level 0
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
    : columns_(width / kCell + 3),
      rows_(height / kCell + 3),
      cells_(static_cast<size_t>(columns_) * static_cast<size_t>(rows_), Cell{kNone, kNone}) {}

void DepthOrder::clear() {
  std::fill(cells_.begin(), cells_.end(), Cell{kNone, kNone});
}

size_t DepthOrder::cell_of(const Eigen::Vector2f& pixel) const {
  const int column = std::clamp(static_cast<int>(pixel.x()) / kCell + 1, 1, columns_ - 2);
  const int row = std::clamp(static_cast<int>(pixel.y()) / kCell + 1, 1, rows_ - 2);
  return static_cast<size_t>(row * columns_ + column);
}

void DepthOrder::add(const Eigen::Vector2f& pixel, float depth) {
  cells_[cell_of(pixel)].add(depth);
}

bool DepthOrder::is_hidden(const Eigen::Vector2f& pixel, float depth, float behind) const {
  const size_t cell = cell_of(pixel);
  Cell front{kNone, kNone};
  for (const int row : {-columns_, 0, columns_}) {
    for (const int column : {-1, 0, 1}) {
      const Cell& near = cells_[cell + static_cast<size_t>(row + column)];
      front.add(near.nearest);
      front.add(near.second);
    }
  }
  return depth > behind * front.second;
}

}  // namespace cairn
