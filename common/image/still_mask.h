// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/base/reset_on_move.h"
#include "common/image/corners.h"
#include "common/image/pyramid.h"

namespace cairn {

/// The parts of a camera's images that stand still whatever the camera does: the rim and the notch of a
/// lens's circle, a water mark, a border. What is found there says nothing of the motion. A grid of cells of
/// 8x8 px of level 0, which are the pixels of pyramid level 3. Immutable.
class StillMask {
 public:
  /// `still`: one byte a cell in row-major order, other than 0 where the image stands still.
  StillMask(int width, int height, std::vector<uint8_t> still);

  [[nodiscard]] int width() const { return width_; }    ///< [cells]
  [[nodiscard]] int height() const { return height_; }  ///< [cells]
  /// Whether the cell itself stands still.
  [[nodiscard]] bool is_still(int x, int y) const { return still_[index(x, y)] != 0; }
  [[nodiscard]] size_t still_cells() const;

  /// Whether a corner at pixel (x, y) of a pyramid level may be one of what stands still: what FAST and a
  /// patch look at around it reaches into such a cell.
  [[nodiscard]] bool touches(int x, int y, int level) const {
    const int shift = kPyramidLevels - 1 - level;
    const int column = x >> shift;
    const int row = y >> shift;
    if (column >= width_ || row >= height_) return false;
    return (touched_[index(column, row)] >> level & 1) != 0;
  }
  /// Whether a pixel of level 0 lies in such a cell.
  [[nodiscard]] bool covers(const Eigen::Vector2f& pixel) const;
  /// Takes corners that touch() from the list of a level.
  void remove_from(CornerList* corners, int level) const;
  /// Takes those that lie in such cells, and leaves what is seen beside them.
  void remove_covered_from(CornerList* corners, int level) const;

 private:
  [[nodiscard]] size_t index(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }

  ResetOnMove<int> width_;
  ResetOnMove<int> height_;
  std::vector<uint8_t> still_;
  std::vector<uint8_t> touched_;  ///< bit l of a cell: corners of level l there touch what stands still
};

using StillMaskPtr = std::shared_ptr<const StillMask>;

/// The mask as it is sent and kept in files: a bit for each cell, row by row, the lowest bit of a byte first.
/// Empty for a null mask.
[[nodiscard]] std::vector<uint8_t> bits_of(const StillMaskPtr& mask);
/// Bytes of a mask of images of this size [px].
[[nodiscard]] size_t still_mask_bytes(int image_width, int image_height);
/// The mask that bits_of() gave, for images of this size [px]. Null when the bits are not as many as such a
/// mask has, or none is set.
[[nodiscard]] StillMaskPtr still_mask_of(int image_width, int image_height, std::span<const uint8_t> bits);

}  // namespace cairn
