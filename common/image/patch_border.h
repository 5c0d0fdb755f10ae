// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/image/patch.h"

namespace cairn {

/// [px of the level] that a corner must lie inside of an image to become a point: half a source patch, and a
/// pixel on either side of it for its gradient. A size, no option.
inline constexpr int kPatchBorder = kSourcePatchSize / 2 + 2;

}  // namespace cairn
