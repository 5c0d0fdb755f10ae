// SPDX-License-Identifier: Apache-2.0
#include "common/image/fit_warp.h"

#include "common/geometry/affine_map.h"

namespace cairn {

Warp fit_warp(std::span<const PixelMatch> matches) {
  const Warp warp = fit_affine_map(matches).cast<float>();
  return warp_level(warp) ? warp : Warp::Identity();
}

}  // namespace cairn
