// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "common/image/image.h"

namespace cairn {

constexpr int kPyramidLevels = 4;  ///< PTAM r114

/// Level-L pixel of a level-0 pixel and back. A level halves by averaging 2x2 blocks, so the centre of pixel
/// 0 of level L lies at (2^L - 1) / 2 of level 0.
[[nodiscard]] inline float to_level(float level0, int level) {
  const float scale = static_cast<float>(1 << level);
  return (level0 + 0.5F) / scale - 0.5F;
}
[[nodiscard]] inline float from_level(float at_level, int level) {
  const float scale = static_cast<float>(1 << level);
  return (at_level + 0.5F) * scale - 0.5F;
}

/// Four levels of an image, each the 2x2 mean ((a+b+c+d+2)/4, exactly) of the one below; odd last rows and
/// columns drop. Level 0 is a copy, so the source may go. Reusable without allocation for frames of one size.
class Pyramid {
 public:
  void build(const GrayView& image);
  [[nodiscard]] const GrayImage& level(int l) const { return levels_[static_cast<size_t>(l)]; }

 private:
  std::array<GrayImage, kPyramidLevels> levels_;
};

/// dst = 2x2 means of src; vectorized, exact, equal on every machine.
void halve(const GrayView& src, GrayImage* dst);

}  // namespace cairn
