// SPDX-License-Identifier: Apache-2.0
#include "tests/world/tile_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#define CAIRN_INLINE [[gnu::always_inline]] inline

namespace cairn {
namespace {

constexpr int kLanes = 8;
constexpr float kLeastInverseDepth = 1e-3F;  // 1/m
using Float8 [[gnu::vector_size(32)]] = float;
using Int8 [[gnu::vector_size(32)]] = int32_t;
using Byte8 [[gnu::vector_size(8)]] = uint8_t;
using UInt8 [[gnu::vector_size(32)]] = uint32_t;

CAIRN_INLINE Float8 load(const float* from) {
  Float8 v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
CAIRN_INLINE Int8 load(const int32_t* from) {
  Int8 v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
CAIRN_INLINE void store(float* to, Float8 v) {
  std::memcpy(to, &v, sizeof v);
}
CAIRN_INLINE void store(int32_t* to, Int8 v) {
  std::memcpy(to, &v, sizeof v);
}
CAIRN_INLINE Float8 to_float(Int8 v) {
  return __builtin_convertvector(v, Float8);
}
CAIRN_INLINE Float8 to_float(UInt8 v) {
  return to_float((Int8)v);
}
CAIRN_INLINE Int8 floor_to_int(Float8 v) {
  const Int8 truncated = __builtin_convertvector(v, Int8);
  return truncated + (to_float(truncated) > v);  // a true comparison is -1
}
CAIRN_INLINE Float8 max(Float8 a, Float8 b) {
  return a > b ? a : b;
}
CAIRN_INLINE Float8 min(Float8 a, Float8 b) {
  return a < b ? a : b;
}
CAIRN_INLINE Float8 evaluate(const LinearFunction& f, Float8 x, Float8 y) {
  return x * f.dx + y * f.dy + f.constant;
}

/// What is nearest at each pixel of a tile.
struct Visibility {
  alignas(32) std::array<float, kTilePixels> inverse_depth;
  alignas(32) std::array<int32_t, kTilePixels> face;  ///< index into the tile's faces, -1 none
};

CAIRN_INLINE void rasterize(const TileRays& rays, const CoverageSample& sample, Visibility* nearest) {
  nearest->inverse_depth.fill(0);
  nearest->face.fill(-1);
  for (size_t index = 0; index < sample.faces.size(); ++index) {
    const ProjectedFace& face = *sample.faces[index].face;
    std::array<LinearFunction, kMaxFaceCorners> edges;
    size_t edge_count = 0;
    for (uint32_t left = sample.faces[index].crossing_edges; left != 0; left &= left - 1) {
      edges[edge_count++] = face.edges[static_cast<size_t>(std::countr_zero(left))];
    }
    for (size_t at = 0; at < kTilePixels; at += kLanes) {
      const Float8 x = load(&rays.x[at]) + sample.shift.x;
      const Float8 y = load(&rays.y[at]) + sample.shift.y;
      const Float8 inverse_depth = evaluate(face.inverse_depth, x, y);
      const Float8 best = load(&nearest->inverse_depth[at]);
      Int8 inside = inverse_depth > best;
      for (size_t edge = 0; edge < edge_count; ++edge) inside &= evaluate(edges[edge], x, y) >= 0.0F;
      store(&nearest->inverse_depth[at], inside ? inverse_depth : best);
      store(&nearest->face[at], inside ? Int8{} + static_cast<int32_t>(index) : load(&nearest->face[at]));
    }
  }
}

/// Grey values at (u, v) in texels of the level, centre of texel 0 at 0.5.
CAIRN_INLINE Float8 bilinear(const Texture::Level& level, Float8 u, Float8 v) {
  u -= 0.5F;
  v -= 0.5F;
  const Int8 column = floor_to_int(u);
  const Int8 row = floor_to_int(v);
  const Float8 right = u - to_float(column);
  const Float8 below = v - to_float(row);
  const Int8 at = (row & level.height_mask) * level.stride + (column & level.width_mask);
  UInt8 quad;
  for (int lane = 0; lane < kLanes; ++lane) quad[lane] = level.quad(at[lane]);
  const Float8 top_left = to_float(quad & 255U);
  const Float8 bottom_left = to_float((quad >> 8) & 255U);
  const Float8 top_right = to_float((quad >> 16) & 255U);
  const Float8 bottom_right = to_float(quad >> 24);
  const Float8 top = top_left + right * (top_right - top_left);
  const Float8 bottom = bottom_left + right * (bottom_right - bottom_left);
  return top + below * (bottom - top);
}

CAIRN_INLINE float smallest(Float8 v) {
  v = min(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
  v = min(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
  return std::min(v[0], v[1]);
}

/// log2 of positive numbers, piecewise linear between powers of two (error < 0.09: a texture level is no
/// finer than that).
CAIRN_INLINE Float8 approximate_log2(Float8 v) {
  return to_float((Int8)v) * 0x1.0p-23F - 127.0F;
}

/// What eight neighbouring pixels show of one face, and where that lies on its texture.
struct Fragment {
  Float8 coverage;  ///< weight in each pixel
  Float8 u;
  Float8 v;
  Float8 lod;  ///< texture level, 0 the finest; in lanes without coverage the coarsest
  const ProjectedFace* face;
  size_t at;  ///< first pixel
};

// Fragments are made for a whole tile, then located, then shaded: three short loops of independent steps keep
// the processor busy where one long chain per fragment (depth, division, level, address, load) would leave it
// waiting.
constexpr size_t kMaxCoverageSamples = 2;
struct FragmentList {
  std::array<Fragment, kMaxCoverageSamples * kTilePixels> items;
  size_t size = 0;
};

CAIRN_INLINE void locate(const TileRays& rays, RayShift shift, const SamplingParameters& parameters,
                         Fragment* fragment) {
  const ProjectedFace& face = *fragment->face;
  const Float8 x = load(&rays.x[fragment->at]) + shift.x;
  const Float8 y = load(&rays.y[fragment->at]) + shift.y;
  // Bounded: the shading sample may lie a little outside what the coverage samples saw of the face.
  const Float8 depth = 1.0F / max(evaluate(face.inverse_depth, x, y), Float8{} + kLeastInverseDepth);
  const Float8 u = evaluate(face.u_over_depth, x, y) * depth;
  const Float8 v = evaluate(face.v_over_depth, x, y) * depth;
  // Level of detail from the mean square of the four texel-per-pixel derivatives: between the long and the
  // short axis of the pixel's footprint; the samples of a pixel lie closer together than pixels and cover the
  // long axis.
  const Float8 step = depth * parameters.ideal_per_pixel;
  const Float8 u_x = (face.u_over_depth.dx - u * face.inverse_depth.dx) * step;
  const Float8 u_y = (face.u_over_depth.dy - u * face.inverse_depth.dy) * step;
  const Float8 v_x = (face.v_over_depth.dx - v * face.inverse_depth.dx) * step;
  const Float8 v_y = (face.v_over_depth.dy - v * face.inverse_depth.dy) * step;
  const Float8 spread = 0.5F * (u_x * u_x + u_y * u_y + v_x * v_x + v_y * v_y);
  const Float8 coarsest = Float8{} + static_cast<float>(face.texture->levels().size() - 1);
  const Float8 lod = 0.5F * approximate_log2(spread) + parameters.lod_bias;
  fragment->u = u;
  fragment->v = v;
  fragment->lod = min(max(fragment->coverage > 0.0F ? lod : coarsest, Float8{}), coarsest);
}

/// Trilinear look-up. Lanes without coverage give anything finite.
CAIRN_INLINE Float8 shade(const Fragment& fragment) {
  // One pair of levels serves all eight pixels: the level hardly changes from one to the last.
  const auto& levels = fragment.face->texture->levels();
  const auto lower = static_cast<size_t>(smallest(fragment.lod));
  const size_t upper = std::min(lower + 1, levels.size() - 1);
  const float lower_scale = std::bit_cast<float>(static_cast<uint32_t>(127 - lower) << 23);
  const float upper_scale = std::bit_cast<float>(static_cast<uint32_t>(127 - upper) << 23);
  const Float8 fraction = min(fragment.lod - static_cast<float>(lower), Float8{} + 1.0F);
  const Float8 fine = bilinear(levels[lower], fragment.u * lower_scale, fragment.v * lower_scale);
  const Float8 coarse = bilinear(levels[upper], fragment.u * upper_scale, fragment.v * upper_scale);
  return (fine + fraction * (coarse - fine)) * fragment.face->brightness;
}

CAIRN_INLINE bool all_equal(Int8 v) {
  const Int8 difference = v ^ v[0];
  std::array<uint64_t, 4> words;
  std::memcpy(words.data(), &difference, sizeof words);
  return (words[0] | words[1] | words[2] | words[3]) == 0;
}

/// Adds coverage to the fragment of a face, among those of the same eight pixels (from `first` on) or a new
/// one.
CAIRN_INLINE void add_coverage(const ProjectedFace* face, Float8 coverage, size_t at, size_t first,
                               FragmentList* fragments) {
  for (size_t i = first; i < fragments->size; ++i) {
    if (fragments->items[i].face != face) continue;
    fragments->items[i].coverage += coverage;
    return;
  }
  Fragment& fragment = fragments->items[fragments->size++];
  fragment.coverage = coverage;
  fragment.face = face;
  fragment.at = at;
}

/// Fragments of eight pixels as one coverage sample sees them.
CAIRN_INLINE void add_fragments(std::span<const TileFace> faces, Int8 face, float share, size_t at,
                                size_t first, FragmentList* fragments) {
  if (face[0] >= 0 && all_equal(face)) {
    add_coverage(faces[static_cast<size_t>(face[0])].shading, Float8{} + share, at, first, fragments);
    return;
  }
  Int8 done = face < 0;
  for (int lane = 0; lane < kLanes; ++lane) {
    if (done[lane] != 0) continue;
    const Int8 mask = face == face[lane];
    add_coverage(faces[static_cast<size_t>(face[lane])].shading, mask ? Float8{} + share : Float8{}, at,
                 first, fragments);
    done |= mask;
  }
}

/// What the coverage samples see of a tile, as fragments.
CAIRN_INLINE void find_fragments(const TileRays& rays, std::span<const CoverageSample> coverage, float weight,
                                 FragmentList* fragments) {
  if (coverage.size() == 1 && coverage[0].faces.size() == 1 && coverage[0].faces[0].crossing_edges == 0) {
    for (size_t at = 0; at < kTilePixels; at += kLanes) {
      add_coverage(coverage[0].faces[0].shading, Float8{} + weight, at, fragments->size, fragments);
    }
    return;
  }
  std::array<Visibility, kMaxCoverageSamples> nearest;
  const size_t count = std::min(coverage.size(), kMaxCoverageSamples);
  for (size_t i = 0; i < count; ++i) rasterize(rays, coverage[i], &nearest[i]);
  const float share = weight / static_cast<float>(count);
  for (size_t at = 0; at < kTilePixels; at += kLanes) {
    const size_t first = fragments->size;
    for (size_t i = 0; i < count; ++i) {
      add_fragments(coverage[i].faces, load(&nearest[i].face[at]), share, at, first, fragments);
    }
  }
}

CAIRN_INLINE void sample_body(const TileRays& rays, RayShift shading_shift,
                              std::span<const CoverageSample> coverage, const SamplingParameters& parameters,
                              float weight, TileSum* sum) {
  FragmentList fragments;
  find_fragments(rays, coverage, weight, &fragments);
  for (size_t i = 0; i < fragments.size; ++i) locate(rays, shading_shift, parameters, &fragments.items[i]);
  for (size_t i = 0; i < fragments.size; ++i) {
    const Fragment& fragment = fragments.items[i];
    store(&(*sum)[fragment.at], load(&(*sum)[fragment.at]) + fragment.coverage * shade(fragment));
  }
}

constexpr int kNormalBits = 12;

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

/// Standard normal numbers of eight counters: murmur3's finalizer, then the quantile table.
CAIRN_INLINE Float8 normal(UInt8 counter, uint32_t key, const float* quantiles) {
  UInt8 h = counter * 0x9E3779B9U + key;
  h = (h ^ (h >> 16)) * 0x85EBCA6BU;
  h = (h ^ (h >> 13)) * 0xC2B2AE35U;
  h = (h ^ (h >> 16)) >> (32 - kNormalBits);
  Float8 v;
  for (int lane = 0; lane < kLanes; ++lane) v[lane] = quantiles[h[lane]];
  return v;
}

CAIRN_INLINE void develop_body(const TileRays& rays, const TileSum& sum, const DevelopParameters& parameters,
                               std::array<uint8_t, kTilePixels>* pixels) {
  const float* quantiles = normal_quantiles().data();
  const UInt8 lanes = {0, 1, 2, 3, 4, 5, 6, 7};
  for (size_t at = 0; at < kTilePixels; at += kLanes) {
    const Float8 x = load(&rays.x[at]);
    const Float8 y = load(&rays.y[at]);
    const Float8 secant2 = 1.0F + x * x + y * y;
    const Float8 falloff = 1.0F - parameters.vignetting * (1.0F - 1.0F / (secant2 * secant2));
    Float8 grey = load(&sum[at]) * parameters.gain * falloff;
    if (parameters.noise_sigma > 0) {
      const auto row = static_cast<uint32_t>(at / kTileWidth);
      const auto column = static_cast<uint32_t>(at % kTileWidth);
      const uint32_t first = parameters.first_pixel + row * parameters.pixels_per_row + column;
      grey += parameters.noise_sigma * normal(lanes + first, parameters.noise_key, quantiles);
    }
    grey = min(max(grey + 0.5F, Float8{}), Float8{} + 255.0F);
    const Byte8 rounded = __builtin_convertvector(__builtin_convertvector(grey, Int8), Byte8);
    std::memcpy(&(*pixels)[at], &rounded, sizeof rounded);
  }
}

void sample_baseline(const TileRays& rays, RayShift shading_shift, std::span<const CoverageSample> coverage,
                     const SamplingParameters& parameters, float weight, TileSum* sum) {
  sample_body(rays, shading_shift, coverage, parameters, weight, sum);
}
void develop_baseline(const TileRays& rays, const TileSum& sum, const DevelopParameters& parameters,
                      std::array<uint8_t, kTilePixels>* pixels) {
  develop_body(rays, sum, parameters, pixels);
}
[[gnu::target("avx2")]] void sample_avx2(const TileRays& rays, RayShift shading_shift,
                                         std::span<const CoverageSample> coverage,
                                         const SamplingParameters& parameters, float weight, TileSum* sum) {
  sample_body(rays, shading_shift, coverage, parameters, weight, sum);
}
[[gnu::target("avx2")]] void develop_avx2(const TileRays& rays, const TileSum& sum,
                                          const DevelopParameters& parameters,
                                          std::array<uint8_t, kTilePixels>* pixels) {
  develop_body(rays, sum, parameters, pixels);
}

constexpr TileKernels kBaseline = {sample_baseline, develop_baseline};
constexpr TileKernels kAvx2 = {sample_avx2, develop_avx2};

}  // namespace

const TileKernels& baseline_kernels() {
  return kBaseline;
}

const TileKernels& best_kernels() {
  return __builtin_cpu_supports("avx2") != 0 ? kAvx2 : kBaseline;
}

}  // namespace cairn
