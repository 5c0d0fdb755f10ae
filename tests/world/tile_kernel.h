// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "tests/world/projected_face.h"

namespace cairn {

// A tile is what fits the first-level cache; rows short enough for a rolling shutter to move little within
// one.
constexpr int kTileWidth = 32;
constexpr int kTileHeight = 8;
constexpr int kTilePixels = kTileWidth * kTileHeight;
// Within a tile, squares of so many pixels a side: few faces cross each.
constexpr int kBlockSize = 8;
constexpr int kTileBlocks = kTileWidth / kBlockSize;
static_assert(kTileHeight == kBlockSize);

/// Ideal image points (plane z = 1) of the pixels of a tile.
struct TileRays {
  alignas(32) std::array<float, kTilePixels> x;  ///< row-major
  alignas(32) std::array<float, kTilePixels> y;
  struct Block {
    alignas(32) std::array<float, kBlockSize> middle_x;  ///< of each row of the block
    alignas(32) std::array<float, kBlockSize> middle_y;
    IdealBox box;  ///< of the rays, with room for shifts within the pixel
  };
  std::array<Block, kTileBlocks> blocks;
};

/// Fills in the blocks from the rays; shifts within the pixel are at most `margin`.
void make_blocks(float margin, TileRays* rays);

/// A face that may show in a tile.
struct TileFace {
  const ProjectedFace* face = nullptr;
  uint32_t crossing_edges = 0;  ///< bit i: edge i crosses the tile
};

using TileSum = std::array<float, kTilePixels>;  ///< grey values, weighted sum of samples

/// Displacement of one sample within the pixel, in the ideal plane.
struct RayShift {
  float x = 0;
  float y = 0;
};

constexpr size_t kMaxCoverageShifts = 2;

/// One look at a tile.
struct TileSample {
  std::span<const TileFace> faces;
  RayShift shading;  ///< where texture is looked up
  /// Displacements at which faces are told apart: 1 to kMaxCoverageShifts of them. Texture, which costs most,
  /// is looked up once for all of them (multisample anti-aliasing).
  std::span<const RayShift> coverage;
  float weight = 1;
};

struct SamplingParameters {
  float ideal_per_pixel = 0;  ///< width of a pixel in the plane z = 1: 1 / focal length
  float lod_bias = 0;         ///< texture levels, negative is sharper
};

/// Parameters by which the summed light of a tile becomes pixels.
struct DevelopParameters {
  float gain = 1;         ///< grey value = sum * gain
  float vignetting = 0;   ///< 0 none, 1 the cos^4 law
  float noise_sigma = 0;  ///< grey levels
  uint32_t noise_key = 0;
  uint32_t first_pixel = 0;     ///< number of the tile's first pixel, for the noise
  uint32_t pixels_per_row = 0;  ///< likewise, from row to row
};

/// The inner loops, built for SSE2 and AVX2. Both do the same arithmetic in the same order: the same bytes.
struct TileKernels {
  /// Adds the light of every pixel, times the sample's weight, to `sum`: texture (trilinear), mixed as the
  /// coverage shows the faces; black where there is no face.
  void (*sample)(const TileRays& rays, const TileSample& sample, const SamplingParameters& parameters,
                 TileSum* sum);
  /// Gain, vignetting, noise, rounding; row-major pixels of the tile.
  void (*develop)(const TileRays& rays, const TileSum& sum, const DevelopParameters& parameters,
                  std::array<uint8_t, kTilePixels>* pixels);
};

[[nodiscard]] const TileKernels& baseline_kernels();
/// The fastest this processor can run.
[[nodiscard]] const TileKernels& best_kernels();

}  // namespace cairn
