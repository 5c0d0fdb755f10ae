// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

#include "common/image/corners.h"
#include "common/image/pyramid.h"
#include "common/image/tiny_image.h"

namespace cairn {

/// What the tracker computes from a frame before it looks at a map. Reused without allocation for frames of
/// one size.
struct FrameImages {
  /// FAST thresholds by level (PTAM r114).
  static constexpr std::array<int, kPyramidLevels> kFastThresholds = {10, 15, 15, 10};

  Pyramid pyramid;
  std::array<CornerList, kPyramidLevels> corners;
  TinyImage tiny;  ///< blur 0.75: frame-to-frame rotation prior

  void build_pyramid(const GrayView& image) { pyramid.build(image); }
  void build_tiny() {
    constexpr float kPriorBlur = 0.75F;  // PTAM r114
    tiny = TinyImage(pyramid.level(kPyramidLevels - 1), kPriorBlur);
  }
  void find_corners() {
    for (size_t l = 0; l < corners.size(); ++l) {
      detect_fast10(pyramid.level(static_cast<int>(l)), kFastThresholds[l], &corners[l]);
    }
  }
};

}  // namespace cairn
