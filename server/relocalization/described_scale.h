// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "common/image/descriptor.h"
#include "common/image/image.h"

namespace cairn {

/// One scale of an image, to describe corners of it: a pyramid level, or half an octave coarser than one.
/// It is smoothed as a whole for many corners, around each for a few: the descriptors are the same. Not for
/// several threads at once.
class DescribedScale {
 public:
  /// `level` has to outlive it. `is_half`: reduced by the square root of two. `corners`: so many will be
  /// described, about.
  DescribedScale(const GrayView& level, bool is_half, size_t corners);

  /// The corner at a pixel of the level. False: it lies too close to the border.
  [[nodiscard]] bool describe(const Eigen::Vector2f& pixel, Descriptor* out);

 private:
  [[nodiscard]] Eigen::Vector2i nearest_pixel(const Eigen::Vector2f& pixel) const;
  /// From (left, top) on.
  void smooth(int left, int top, int width, int height);

  GrayView level_;
  bool is_half_;
  int width_;
  int height_;
  bool is_whole_;
  int left_ = 0;
  int top_ = 0;
  GrayImage reduced_;
  GrayImage smoothed_;  ///< from (left_, top_) on
};

}  // namespace cairn
