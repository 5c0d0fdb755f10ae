// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "common/image/patch.h"
#include "common/image/tiny_image.h"

namespace cairn {

/// How the pixels of a frame move while it is exposed, which smears its image: a shift and a turn about the
/// optical axis, as the small images see it.
class Smear {
 public:
  Smear() = default;  ///< of a camera at rest
  /// The smear of a frame whose exposure takes the `share` of `motion`, which is the motion from the frame
  /// before to this one. `width`, `height` of the image [px of level 0]. No smear where the small images have
  /// nothing in common.
  Smear(const TinyMotion& motion, float share, int width, int height);

  [[nodiscard]] bool is_none() const { return is_none_; }
  /// The way of a pixel from the begin to the end of the exposure, to first order [px of level 0].
  [[nodiscard]] Eigen::Vector2f at(const Eigen::Vector2f& pixel) const {
    if (is_none_) return Eigen::Vector2f::Zero();
    return shift_ + angle_ * Eigen::Vector2f(center_.y() - pixel.y(), pixel.x() - center_.x());
  }

 private:
  bool is_none_ = true;
  Eigen::Vector2f center_ = Eigen::Vector2f::Zero();
  Eigen::Vector2f shift_ = Eigen::Vector2f::Zero();
  float angle_ = 0;
};

/// The smear to add to one that a patch `has` for it to look as with the smear `wanted`: variances add up,
/// and what lies across is left alone.
[[nodiscard]] Eigen::Vector2f missing_smear(const Eigen::Vector2f& wanted, const Eigen::Vector2f& has);

/// Makes a template as make_template() does, but smeared and moved. It looks as in an image during whose
/// exposure the patch's pixels go the way `smear` [px of level 0]; template pixel (4, 4) lies `aside`
/// [search-level px] from the reference pixel. A smear that reaches beyond the patch is shortened. False also
/// where `smear` is not finite.
[[nodiscard]] bool make_smeared_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                                         const Eigen::Vector2f& smear, const Eigen::Vector2f& aside,
                                         PatchTemplate* out);

}  // namespace cairn
