// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <utility>

#include "common/image/corners.h"
#include "common/image/pyramid.h"
#include "common/image/smear.h"
#include "common/image/still_mask.h"
#include "common/image/tiny_image.h"

namespace cairn {

/// The images that the tracker computes from a frame before it looks at a map. Reused without allocation for
/// frames of one size.
class FrameImages {
 public:
  Pyramid pyramid;
  Smear smear;     ///< of its exposure, as far as it is known
  TinyImage tiny;  ///< blur 0.75: frame-to-frame rotation prior

  /// `still` (null: nothing): where the image stands still whatever the camera does; there are no corners
  /// there, and the tiny image says nothing of it.
  void build_pyramid(const GrayView& image, StillMaskPtr still = nullptr) {
    pyramid.build(image);
    still_ = std::move(still);
    smear = {};
    has_corners_.fill(false);
  }
  void build_tiny() {
    constexpr float kPriorBlur = 0.75F;  // PTAM r114
    tiny.assign(pyramid.level(kPyramidLevels - 1), kPriorBlur, still_.get());
  }
  [[nodiscard]] const StillMaskPtr& still() const { return still_; }
  /// Replaces the mask, when more is known about what stands still: corners and the tiny image are made anew.
  void use_mask(StillMaskPtr still) {
    still_ = std::move(still);
    has_corners_.fill(false);
    build_tiny();
  }
  /// The corners of one pyramid level. They are detected at the first call for it, since those of the large
  /// levels cost a fifth of a frame's time and most frames never need them. One thread.
  [[nodiscard]] const CornerList& corners(int level) const {
    const auto l = static_cast<size_t>(level);
    if (!has_corners_[l]) {
      detect_fast10(pyramid.level(level), kFastThresholds[l], &corners_[l]);
      if (still_) still_->remove_from(&corners_[l], level);
    }
    has_corners_[l] = true;
    return corners_[l];
  }
  [[nodiscard]] const std::array<CornerList, kPyramidLevels>& all_corners() const {
    for (int level = 0; level < kPyramidLevels; ++level) (void)corners(level);
    return corners_;
  }

 private:
  StillMaskPtr still_;
  mutable std::array<CornerList, kPyramidLevels> corners_;
  mutable std::array<bool, kPyramidLevels> has_corners_{};
};

}  // namespace cairn
