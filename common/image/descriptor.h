// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/image/corners.h"
#include "common/image/image.h"

namespace cairn {

/// 256 brightness comparisons around a corner, turned with it (steered BRIEF: Calonder et al., ECCV 2010;
/// orientation by the intensity centroid as ORB: Rublee et al., ICCV 2011). Indifferent to gain, bias and
/// roll; stands changes of scale by about 1.4. The pattern is our own and part of the wire: client and server
/// must agree on it.
using Descriptor = std::array<uint64_t, 4>;

constexpr int kDescriptorRadius = 13;  ///< px around the corner that are read, after smoothing
constexpr int kSmoothingRadius = 4;    ///< px around each that smooth_for_descriptors() reads

/// Number of comparisons that differ, 0..256.
[[nodiscard]] int descriptor_distance(const Descriptor& a, const Descriptor& b);

/// The image blurred by the binomial [1 4 6 4 1]/16 twice (sigma 1.4), borders repeated: single noisy pixels
/// do not decide comparisons. `out` keeps its memory.
void smooth_for_descriptors(const GrayView& image, GrayImage* out);

/// Describes a corner of a smoothed image. False when it lies closer than kDescriptorRadius to the border.
[[nodiscard]] bool describe(const GrayView& smoothed, Corner corner, Descriptor* out);

/// Distances to each of a set, in its order; `out` has room for them. By population count where the machine
/// has it.
void descriptor_distances(const Descriptor& query, std::span<const Descriptor> set, uint16_t* out);

/// A descriptor of a set that is near a query, by its index.
struct NearDescriptor {
  uint32_t index = 0;
  int distance = 0;
};
/// [begin, end).
struct IndexRange {
  uint32_t begin = 0;
  uint32_t end = 0;
};
/// The distance beyond which no distance times `ratio` (0 < ratio <= 1) is at most `least`. It has a step of
/// margin, since the quotient is rounded: one may be kept that is too far, none is lost.
[[nodiscard]] constexpr int farthest_within_ratio(int least, float ratio) {
  return static_cast<int>(static_cast<float>(least) / ratio) + 1;
}
/// Appends the nearest descriptor within some ranges of a set, and all in them that lie no farther than
/// farthest_within_ratio() of its distance (0 < ratio <= 1), in the order of the ranges. Appends none if the
/// nearest is more than `limit` away.
void find_nearest_few(const Descriptor& query, std::span<const Descriptor> set,
                      std::span<const IndexRange> ranges, int limit, float ratio,
                      std::vector<NearDescriptor>* out);

/// The nearest of a set and how near the second nearest is. index -1 for an empty set.
struct NearestDescriptor {
  int index = -1;
  int distance = 257;
  int second_distance = 257;
};
/// Linear scan; ties go to the lower index. Vectorized by population count where the machine has it.
[[nodiscard]] NearestDescriptor find_nearest(const Descriptor& query, std::span<const Descriptor> set);

}  // namespace cairn
