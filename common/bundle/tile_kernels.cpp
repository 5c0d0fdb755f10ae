// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/tile_kernels.h"

#include <cmath>

// One source, two instruction sets. GCC lowers vectors wider than the target before it inlines, so templates
// shared between targets would lose the wide ones; and no file is compiled with -mavx2, so no inline function
// of a header can leak AVX code into a program that runs without it.
namespace cairn {
namespace baseline {
namespace {
#include "common/bundle/tile_kernels.inl"
}  // namespace
}  // namespace baseline

#pragma GCC push_options
#pragma GCC target("avx2")
namespace avx2 {
namespace {
#include "common/bundle/tile_kernels.inl"
}  // namespace
}  // namespace avx2
#pragma GCC pop_options

const TileKernels& baseline_tile_kernels() {
  return baseline::kKernels;
}

const TileKernels& best_tile_kernels() {
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  return has_avx2 ? avx2::kKernels : baseline::kKernels;
}

}  // namespace cairn
