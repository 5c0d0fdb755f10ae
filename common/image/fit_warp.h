// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "common/geometry/two_view.h"
#include "common/image/patch.h"

namespace cairn {

/// How patches of the first view look in the second, as far as the matches tell (fit_affine_map): unwarped
/// ones would be found a fraction of a pixel off, all to the same side. Identity where that is no warp that a
/// template can have (warp_level). Pure; safe to call from any thread.
[[nodiscard]] Warp fit_warp(std::span<const PixelMatch> matches);

}  // namespace cairn
