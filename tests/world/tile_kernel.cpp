// SPDX-License-Identifier: Apache-2.0
#include "tests/world/tile_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <optional>

#include "common/base/simd.h"

namespace cairn {
namespace {

// Places between texels in steps of 1/128: two weights and a grey value fit 16-bit products.
constexpr int kWeightBits = 7;
constexpr int16_t kUnitWeight = 1 << kWeightBits;

constexpr int kNormalBits = 10;  // a table that leaves room in the first-level cache

/// Quantiles of the standard normal distribution in the middle of 2^kNormalBits equal steps, scaled to
/// variance 1.
std::array<float, 1 << kNormalBits> make_normal_quantiles() {
  std::array<float, 1 << kNormalBits> quantiles;
  double power = 0;
  for (size_t i = 0; i < quantiles.size(); ++i) {
    const double probability = (static_cast<double>(i) + 0.5) / static_cast<double>(quantiles.size());
    double low = -10;
    double high = 10;
    for (int halving = 0; halving < 60; ++halving) {
      const double middle = 0.5 * (low + high);
      (0.5 * std::erfc(-middle / std::numbers::sqrt2) < probability ? low : high) = middle;
    }
    quantiles[i] = static_cast<float>(low);
    power += low * low / static_cast<double>(quantiles.size());
  }
  for (float& quantile : quantiles) quantile /= static_cast<float>(std::sqrt(power));
  return quantiles;
}

const std::array<float, 1 << kNormalBits>& normal_quantiles() {
  static const std::array<float, 1 << kNormalBits> quantiles = make_normal_quantiles();
  return quantiles;
}

namespace baseline {
#include "tests/world/tile_kernel_body.inc"
}  // namespace baseline

CAIRN_BEGIN_WIDE
#define CAIRN_KERNEL_WIDE
namespace wide {
#include "tests/world/tile_kernel_body.inc"
}  // namespace wide
#undef CAIRN_KERNEL_WIDE
CAIRN_END_WIDE

constexpr TileKernels kBaseline = {baseline::sample, baseline::develop};
constexpr TileKernels kWideKernels = {wide::sample, wide::develop};

}  // namespace

void make_blocks(float margin, TileRays* rays) {
  for (size_t number = 0; number < kTileBlocks; ++number) {
    TileRays::Block& block = rays->blocks[number];
    const size_t first = number * kBlockSize;
    IdealBox box{rays->x[first], rays->y[first], rays->x[first], rays->y[first]};
    for (size_t row = 0; row < kBlockSize; ++row) {
      const size_t left = first + row * kTileWidth;
      for (size_t at = left; at < left + kBlockSize; ++at) {
        box = box.united({rays->x[at], rays->y[at], rays->x[at], rays->y[at]});
      }
      block.middle_x[row] = 0.5F * (rays->x[left] + rays->x[left + kBlockSize - 1]);
      block.middle_y[row] = 0.5F * (rays->y[left] + rays->y[left + kBlockSize - 1]);
    }
    block.box = {box.x0 - margin, box.y0 - margin, box.x1 + margin, box.y1 + margin};
  }
}

const TileKernels& baseline_kernels() {
  return kBaseline;
}

const TileKernels& best_kernels() {
  return best_simd() == Simd::kWide ? kWideKernels : kBaseline;
}

}  // namespace cairn
