// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

#include "common/image/tiny_image.h"

namespace cairn {

constexpr int kCompactAcross = 10;
constexpr int kCompactDown = 8;
constexpr size_t kCompactSize = size_t{kCompactAcross} * kCompactDown;

/// What is left of a tiny image for a first comparison: the low frequencies (orthonormal cosine transform) of
/// the image scaled to unit length. Row by row from the lowest; the first is 0, as the mean is.
using Compact = std::array<float, kCompactSize>;

/// Zeros for an image without contrast.
[[nodiscard]] Compact compact_of(const TinyImage& tiny);

/// Squared distance. Of two images of one size never more than 2 (1 - their correlation), by Parseval's
/// theorem, and little less: the blur of kPlaceBlur has taken the other frequencies.
[[nodiscard]] float compact_distance(const Compact& a, const Compact& b);

}  // namespace cairn
