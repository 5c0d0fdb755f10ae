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

/// Ideal image points (plane z = 1) of the pixels of a tile, row-major.
struct TileRays {
  alignas(32) std::array<float, kTilePixels> x;
  alignas(32) std::array<float, kTilePixels> y;
};

/// A face that may show in a tile.
struct TileFace {
  const ProjectedFace* face = nullptr;     ///< as the coverage sample sees it
  const ProjectedFace* shading = nullptr;  ///< as the shading sample sees it
  uint32_t crossing_edges = 0;             ///< bit i: edge i crosses the tile
};

using TileSum = std::array<float, kTilePixels>;  ///< grey values, weighted sum of samples

/// Displacement of one sample within the pixel, in the ideal plane.
struct RayShift {
  float x = 0;
  float y = 0;
};

/// One look at a tile to find which face is nearest at each pixel.
struct CoverageSample {
  RayShift shift;
  std::span<const TileFace> faces;
};

struct SamplingParameters {
  float ideal_per_pixel = 0;  ///< width of a pixel in the plane z = 1: 1 / focal length
  float lod_bias = 0;         ///< texture levels, negative is sharper
};

/// From the summed light of a tile to pixels.
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
  /// Adds `weight` times the light of every pixel to `sum`: texture (trilinear) at the shading sample, mixed
  /// as the coverage samples see the faces; black where there is no face. What costs, texture, is looked up
  /// once for several coverage samples (multisample anti-aliasing).
  void (*sample)(const TileRays& rays, RayShift shading_shift, std::span<const CoverageSample> coverage,
                 const SamplingParameters& parameters, float weight, TileSum* sum);
  /// Gain, vignetting, noise, rounding; row-major pixels of the tile.
  void (*develop)(const TileRays& rays, const TileSum& sum, const DevelopParameters& parameters,
                  std::array<uint8_t, kTilePixels>* pixels);
};

[[nodiscard]] const TileKernels& baseline_kernels();
/// The fastest this processor can run.
[[nodiscard]] const TileKernels& best_kernels();

}  // namespace cairn
