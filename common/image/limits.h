// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace cairn {

/// [px] No side of an image is longer, in files or on the wire: keeps a forged header from taking the
/// machine's memory.
inline constexpr int kMaxImageSide = 4096;

/// [px] Of a coordinate, positive or negative: measurements may lie outside the image.
inline constexpr float kMaxPixel = 4 * kMaxImageSide;

}  // namespace cairn
