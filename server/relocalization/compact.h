// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "common/image/tiny_image.h"

namespace cairn {

constexpr size_t kCompactSize = 80;

/// Root mean square [grey levels] of an image of zero mean.
[[nodiscard]] float contrast_of(const TinyImage& tiny);

/// A tiny image reduced for a first comparison: the lowest frequencies of its cosine transform (orthonormal
/// DCT-II), of the image scaled to unit length, so that gain does not matter. The image's mean is zero, so
/// the constant is not among them. They are in the order of their frequency per pixel in an image of 4:3, the
/// lowest first, since the blur takes away the high ones. Where the image is too small to have a frequency
/// the value is 0.
struct CompactImage {
  std::array<float, kCompactSize> values{};  ///< all 0: an image without contrast
  uint16_t width = 0;                        ///< of the tiny image
  uint16_t height = 0;

  friend bool operator==(const CompactImage&, const CompactImage&) = default;
};

[[nodiscard]] CompactImage make_compact(const TinyImage& tiny);

/// Whether two images are of one size: only then can they be compared.
[[nodiscard]] inline bool is_comparable(const CompactImage& a, const CompactImage& b) {
  return a.width == b.width && a.height == b.height;
}

/// Squared distance of two compact images. It is never more than 2 (1 - correlation) of the two tiny images
/// (Parseval), and little less: the blur has taken the other frequencies. Infinite for images of different
/// sizes. Where it exceeds `limit` the result is only some value above that.
[[nodiscard]] float compact_distance(const CompactImage& a, const CompactImage& b,
                                     float limit = std::numeric_limits<float>::infinity());

/// The same for kCompactSize values each, without a check of sizes.
[[nodiscard]] float compact_distance(const float* a, const float* b, float limit);

}  // namespace cairn
