// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "common/image/frame_images.h"
#include "common/image/patch.h"

namespace cairn {

/// When a template is made anew, and how smeared patches are treated.
struct KeptTemplateOptions {
  float template_change = 0.07F;  ///< [search-level px per source px] of a column of the warp (PTAM r114)
  float smear_change = 0.2F;      ///< of the smear's length
  /// [search-level px] Below, the standard deviation of a smear, 0.87, is no more than that of lens and
  /// pixels.
  float least_smear = 3.0F;
  int coarse_level = 2;  ///< level from which on a radius has few pixels, and each is compared
};

/// The template of a point, kept from frame to frame while it looks the same.
class KeptTemplate {
 public:
  /// The template of a patch as a frame shows it that smears it by `smear` [px of level 0]; `level` is that
  /// of the search. Null where it cannot be searched. Valid until the next call.
  [[nodiscard]] const PatchTemplate* of(const SourcePatch& source, const Warp& level0_from_source, int level,
                                        const Eigen::Vector2f& smear, const KeptTemplateOptions& options);

 private:
  PatchTemplate patch_;
  Warp warp_ = Warp::Zero();
  Eigen::Vector2f smear_ = Eigen::Vector2f::Zero();
  bool valid_ = false;
};

/// The place in a frame that resembles the template best within `radius` of `center` [px of its level], to
/// sub-pixel. It is sought at the corners; on coarse levels, where a smear has left none, at every pixel.
/// Nothing where no place resembles it enough.
[[nodiscard]] std::optional<Eigen::Vector2f> look_around(const PatchTemplate& patch, const FrameImages& frame,
                                                         const Eigen::Vector2f& center, float radius,
                                                         int iterations, const KeptTemplateOptions& options);

}  // namespace cairn
