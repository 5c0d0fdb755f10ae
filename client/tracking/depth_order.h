// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "client/tracking/point_search.h"

namespace cairn {

/// Local depth order of a frame: a point that was looked for in vain where clearly nearer points were found
/// stands behind something, and its absence says nothing about the pose. What PTAM lacks, and what makes its
/// quality measure collapse in maps of more than one side of things. Keeps its grid from frame to frame. One
/// thread.
class DepthOrder {
 public:
  /// For images of this size [px].
  DepthOrder(int width, int height);

  /// Points of the frame that were searched, not found, and lie behind at least two found ones nearby.
  [[nodiscard]] int count_hidden(std::span<const VisiblePoint> points);

 private:
  /// Depths of the two nearest found points of a cell; infinite where there are none.
  struct Cell {
    float nearest;
    float second;
    void add(float depth);
  };
  [[nodiscard]] size_t cell_of(const Eigen::Vector2f& pixel) const;
  /// Depth in front of which two found points lie, in the cell and those around it.
  [[nodiscard]] float front_of(size_t cell) const;

  int columns_;  ///< with a border of one cell on each side
  std::vector<Cell> cells_;
};

}  // namespace cairn
