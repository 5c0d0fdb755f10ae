// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace cairn {

/// Local depth order of the points of an image: what lies behind nearer points beside it is hidden by the
/// thing that they are part of, more likely than not, and what is seen at its pixel says nothing about it.
/// Keeps its grid from image to image. One thread.
class DepthOrder {
 public:
  /// Makes an empty grid for images of this size [px].
  DepthOrder(int width, int height);

  void clear();
  /// A point at a pixel; those outside the image count for its rim. Depth in any unit, above 0.
  void add(const Eigen::Vector2f& pixel, float depth);
  /// Whether a point at this pixel is clearly behind two of those added, or more, in its cell of 16 px or
  /// those next to it. `behind`: how many times as deep as they it must be.
  [[nodiscard]] bool is_hidden(const Eigen::Vector2f& pixel, float depth, float behind) const;

 private:
  /// Depths of the two nearest points of a cell; infinite where there are none.
  struct Cell {
    float nearest;
    float second;
    void add(float depth);
  };
  [[nodiscard]] size_t cell_of(const Eigen::Vector2f& pixel) const;

  int columns_;  ///< with a border of one cell on each side
  int rows_;
  std::vector<Cell> cells_;
};

}  // namespace cairn
