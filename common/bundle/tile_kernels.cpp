// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/tile_kernels.h"

#include <cmath>

#include "common/base/simd.h"

// One source, two instruction sets (simd.h).
namespace cairn {
namespace baseline {
namespace {
#include "common/bundle/tile_kernels.inl"
}  // namespace
}  // namespace baseline

CAIRN_BEGIN_WIDE
namespace wide {
namespace {
#include "common/bundle/tile_kernels.inl"
}  // namespace
}  // namespace wide
CAIRN_END_WIDE

const TileKernels& baseline_tile_kernels() {
  return baseline::kKernels;
}

const TileKernels& best_tile_kernels() {
  return best_simd() == Simd::kWide ? wide::kKernels : baseline::kKernels;
}

}  // namespace cairn
