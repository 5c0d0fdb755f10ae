// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/base/simd.h"
#include "common/image/box_sums.h"
#include "common/image/corners.h"
#include "common/image/descriptor.h"
#include "common/image/image.h"
#include "common/image/patch.h"

/// Private to common/image and its tests: the public functions of pyramid.h, corners.h, patch.h and
/// descriptor.h with the variant chosen by the caller. A variant that the machine lacks must not be asked
/// for; one that a kernel lacks falls to the next narrower.
namespace cairn::kernels {

void halve(const GrayView& src, GrayImage* dst, Simd simd);

void detect_fast10(const GrayView& image, int threshold, CornerList* out, Simd simd);

[[nodiscard]] int zmssd_at(const PatchTemplate& patch, const GrayView& level_image, int x, int y, Simd simd);

void search_zmssd(const PatchTemplate& patch, const GrayView& level_image, const BoxSums& sums,
                  std::span<const PixelRun> runs, float ratio, int* limit, std::vector<PatchMatch>* out,
                  Simd simd);

[[nodiscard]] std::optional<PatchMatch> find_patch(const PatchTemplate& patch, const GrayView& level_image,
                                                   const CornerList& corners, const Eigen::Vector2f& center,
                                                   float radius, int max_zmssd, Simd simd);

[[nodiscard]] bool make_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                                 PatchTemplate* out, Simd simd);
[[nodiscard]] bool make_smeared_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                                         const Eigen::Vector2f& smear, const Eigen::Vector2f& aside,
                                         PatchTemplate* out, Simd simd);

[[nodiscard]] std::optional<Eigen::Vector2f> refine_patch(const PatchTemplate& patch,
                                                          const GrayView& level_image,
                                                          const Eigen::Vector2f& start, int max_iterations,
                                                          float max_shift, int max_zmssd, Simd simd);

/// These three by population count, where the machine has it, of words for kNarrow, of vectors for kWide.
void descriptor_distances(const Descriptor& query, std::span<const Descriptor> set, uint16_t* out, Simd simd);
[[nodiscard]] NearestDescriptor find_nearest(const Descriptor& query, std::span<const Descriptor> set,
                                             Simd simd);
void find_nearest_few(const Descriptor& query, std::span<const Descriptor> set,
                      std::span<const IndexRange> ranges, int limit, float ratio,
                      std::vector<NearDescriptor>* out, Simd simd);

}  // namespace cairn::kernels
