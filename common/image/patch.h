// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>

#include "common/image/corners.h"
#include "common/image/image.h"

namespace cairn {

/// Side of a search template, px at the search level (PTAM r114).
constexpr int kTemplateSize = 8;
constexpr size_t kTemplatePixels = size_t{kTemplateSize} * kTemplateSize;
/// Side of a stored patch, px at the source level: room for a template turned by any angle and stretched by
/// up to two.
constexpr int kSourcePatchSize = 24;
constexpr size_t kSourcePatchPixels = size_t{kSourcePatchSize} * kSourcePatchSize;

/// Source patch of a map point: pixel (i, j) is the source level's pixel (x - 12 + i, y - 12 + j) of the
/// (integer) corner.
using SourcePatch = std::array<uint8_t, kSourcePatchPixels>;

/// Copies the 24x24 patch around a corner; nothing if it leaves the image (needs 12 px before, 11 px after).
[[nodiscard]] bool cut_source_patch(const GrayView& image, Corner corner, SourcePatch* out);

/// 2x2 linear map from pixels of the source level to pixels of level 0 in the target image.
using Warp = Eigen::Matrix2f;

/// Level at which to search: raised while the determinant (area of one source pixel in the target, at that
/// level) is above 3, /4 per level; nothing if at that level it is outside (0.25, 3). PTAM r114.
[[nodiscard]] std::optional<int> warp_level(const Warp& level0_from_source);

/// A warped 8x8 template with what its search needs. Template pixel (i, j) belongs to the search-level
/// position (center.x + i - 4, center.y + j - 4): the reference pixel is (4, 4), so it matches a corner's own
/// pixel exactly.
struct PatchTemplate {
  alignas(64) std::array<uint8_t, kTemplatePixels> pixels{};
  alignas(64) std::array<int16_t, kTemplatePixels> gradient_x{};  ///< unhalved central differences
  alignas(64) std::array<int16_t, kTemplatePixels> gradient_y{};
  Eigen::Matrix3f inverse_hessian = Eigen::Matrix3f::Zero();  ///< of (x, y, mean)
  int sum = 0;
  int sum_squares = 0;
  int level = 0;
  bool flat = true;  ///< the Hessian is singular or nearly: no sub-pixel refinement
};

/// Warps a source patch into a template of `level`: `level0_from_source` as in warp_level(). Samples
/// bilinearly; a ring of one pixel more, clamped to the patch, gives full 8x8 gradients. False if one of the
/// 8x8 samples leaves the 24x24 patch.
[[nodiscard]] bool make_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                                 PatchTemplate* out);

struct PatchMatch {
  Corner corner;  ///< search-level pixel
  int zmssd = 0;  ///< sum of squared differences after removing both means, over 64 px
};

/// PTAM r114: reject above 500 per pixel; MCPTAM's 250 is the stricter choice for calibrated cameras.
constexpr int kMaxZmssd = 64 * 250;

/// Best zero-mean SSD over the corners within `radius` px of `center` (all in search-level px) below
/// `max_zmssd`. Vectorized, exact integers. Corners whose 8x8 window leaves the image are passed over.
[[nodiscard]] std::optional<PatchMatch> find_patch(const PatchTemplate& patch, const GrayView& level_image,
                                                   const CornerList& corners, const Eigen::Vector2f& center,
                                                   float radius, int max_zmssd = kMaxZmssd);

/// ZMSSD of the template at an integer position (level px); the window must lie inside.
[[nodiscard]] int zmssd_at(const PatchTemplate& patch, const GrayView& level_image, int x, int y);

/// Inverse compositional alignment (Baker and Matthews, IJCV 2004) on (x, y, mean) from `start`, search-level
/// px. Samples the image by cubic convolution (README.md), for which it needs 5 px of border. Converged when
/// a step is below 0.03 px within `max_iterations`; nothing when it diverges, moves more than `max_shift` px
/// from the start, leaves the image or ends with a ZMSSD (at the refined position) above `max_zmssd`.
[[nodiscard]] std::optional<Eigen::Vector2f> refine_patch(const PatchTemplate& patch,
                                                          const GrayView& level_image,
                                                          const Eigen::Vector2f& start,
                                                          int max_iterations = 10, float max_shift = 3.0F,
                                                          int max_zmssd = kMaxZmssd);

/// Bilinear grey value at (x, y), which must be inside by one pixel.
[[nodiscard]] float sample_bilinear(const GrayView& image, float x, float y);

}  // namespace cairn
