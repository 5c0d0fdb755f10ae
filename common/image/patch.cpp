// SPDX-License-Identifier: Apache-2.0
#include "common/image/patch.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/image/kernels.h"
#include "common/image/pyramid.h"
#include "common/image/smear.h"

namespace cairn {
namespace {

constexpr int kHalf = kTemplateSize / 2;
constexpr int kPixels = kTemplateSize * kTemplateSize;
constexpr float kMinArea = 0.25F;
constexpr float kMaxArea = 3.0F;
constexpr int kFractionBits = 16;
constexpr int kOne = 1 << kFractionBits;
constexpr int kSourceCenter = kSourcePatchSize / 2;
constexpr int kMaxCoordinate =
    (kSourcePatchSize - 1) * kOne - 1;  ///< the sample's right neighbour still exists

/// Where template pixels lie in the source patch, in 16.16 fixed point: exact, so that every variant samples
/// the same spot.
struct SampleGrid {
  int u_per_i;
  int u_per_j;
  int v_per_i;
  int v_per_j;
  /// Of the reference pixel. Bilinear weights have 8 bits: rounded here, once, instead of at every sample.
  int u_origin = kSourceCenter * kOne + (1 << (kFractionBits - 9));
  int v_origin = u_origin;

  [[nodiscard]] int u(int i, int j) const { return u_origin + u_per_i * (i - kHalf) + u_per_j * (j - kHalf); }
  [[nodiscard]] int v(int i, int j) const { return v_origin + v_per_i * (i - kHalf) + v_per_j * (j - kHalf); }
  /// Of the pixels that are (x, y) [template px] away.
  [[nodiscard]] SampleGrid moved(float x, float y) const {
    const auto part = [](float across, int per_i, float down, int per_j) {
      const float way = across * static_cast<float>(per_i) + down * static_cast<float>(per_j);
      return static_cast<int>(way + std::copysign(0.5, way));  // as std::lround(), which is a call
    };
    SampleGrid other = *this;
    other.u_origin += part(x, u_per_i, y, u_per_j);
    other.v_origin += part(x, v_per_i, y, v_per_j);
    return other;
  }

  /// Whether the 8x8 samples lie in the patch: it is convex, so its corners decide.
  [[nodiscard]] bool is_inside() const {
    for (const int j : {0, kTemplateSize - 1}) {
      for (const int i : {0, kTemplateSize - 1}) {
        if (u(i, j) < 0 || u(i, j) > kMaxCoordinate || v(i, j) < 0 || v(i, j) > kMaxCoordinate) return false;
      }
    }
    return true;
  }
};

std::optional<SampleGrid> sample_grid(const Warp& level0_from_source, int level) {
  const Warp source_from_target =
      level0_from_source.inverse() * static_cast<float>(1 << level);  // not finite when singular
  if (!(source_from_target.cwiseAbs().maxCoeff() < static_cast<float>(kSourcePatchSize))) return std::nullopt;
  const auto fixed = [&](int row, int column) {
    return _mm_cvtss_si32(_mm_set_ss(source_from_target(row, column) * static_cast<float>(kOne)));  // rounds
  };
  const SampleGrid grid{fixed(0, 0), fixed(0, 1), fixed(1, 0), fixed(1, 1)};
  if (!grid.is_inside()) return std::nullopt;
  return grid;
}

/// The template with a ring of one pixel around it: pixel (i, j) at at(i, j), -1 <= i, j <= 8 without the
/// corners.
struct RingedTemplate {
  static constexpr int kStride = 16;
  static constexpr size_t kPixels = size_t{kStride} * (kTemplateSize + 2);
  alignas(16) std::array<uint8_t, kPixels> pixels;

  [[nodiscard]] uint8_t* at(int i, int j) { return pixels.data() + (j + 1) * kStride + i + 1; }
  [[nodiscard]] const uint8_t* at(int i, int j) const { return pixels.data() + (j + 1) * kStride + i + 1; }
};

uint8_t sample_fixed(const SourcePatch& source, int u, int v) {
  u = std::clamp(u, 0, kMaxCoordinate);
  v = std::clamp(v, 0, kMaxCoordinate);
  const uint8_t* p = source.data() + (v >> kFractionBits) * kSourcePatchSize + (u >> kFractionBits);
  const int fx = (u >> 8) & 255;
  const int fy = (v >> 8) & 255;
  const int top = (p[0] << 8) + fx * (p[1] - p[0]);
  const int bottom = (p[kSourcePatchSize] << 8) + fx * (p[kSourcePatchSize + 1] - p[kSourcePatchSize]);
  return static_cast<uint8_t>(((top << 8) + fy * (bottom - top) + (1 << 15)) >> 16);
}

void warp_scalar(const SourcePatch& source, const SampleGrid& grid, RingedTemplate* out) {
  for (int j = -1; j <= kTemplateSize; ++j) {
    for (int i = -1; i <= kTemplateSize; ++i)
      *out->at(i, j) = sample_fixed(source, grid.u(i, j), grid.v(i, j));
  }
}

/// Where eight samples lie: the pixel to the upper left of each, and how far [1/256 px] they are from it.
struct Spots {
  __m256i index;
  __m256i fx;
  __m256i fy;
};

CAIRN_AVX2 CAIRN_INLINE Spots spots_avx2(__m256i u, __m256i v) {
  const __m256i zero = _mm256_setzero_si256();
  const __m256i limit = _mm256_set1_epi32(kMaxCoordinate);
  const __m256i byte = _mm256_set1_epi32(255);
  u = _mm256_min_epi32(_mm256_max_epi32(u, zero), limit);
  v = _mm256_min_epi32(_mm256_max_epi32(v, zero), limit);
  const __m256i row =
      _mm256_mullo_epi16(_mm256_srli_epi32(v, kFractionBits), _mm256_set1_epi32(kSourcePatchSize));
  return {_mm256_add_epi32(row, _mm256_srli_epi32(u, kFractionBits)),
          _mm256_and_si256(_mm256_srli_epi32(u, 8), byte), _mm256_and_si256(_mm256_srli_epi32(v, 8), byte)};
}

/// The values of eight samples, from the two bytes at the begin of `top` and the two at the end of `bottom`.
CAIRN_AVX2 CAIRN_INLINE __m256i blend_avx2(const Spots& spots, __m256i top_bytes, __m256i bottom_bytes) {
  const __m256i weights =
      _mm256_or_si256(_mm256_slli_epi32(spots.fx, 16), _mm256_sub_epi32(_mm256_set1_epi32(256), spots.fx));
  const __m256i spread_first = _mm256_setr_epi8(0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1,  //
                                                0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1);
  const __m256i spread_last = _mm256_setr_epi8(2, -1, 3, -1, 6, -1, 7, -1, 10, -1, 11, -1, 14, -1, 15, -1,  //
                                               2, -1, 3, -1, 6, -1, 7, -1, 10, -1, 11, -1, 14, -1, 15, -1);
  const __m256i top = _mm256_madd_epi16(_mm256_shuffle_epi8(top_bytes, spread_first), weights);
  const __m256i bottom = _mm256_madd_epi16(_mm256_shuffle_epi8(bottom_bytes, spread_last), weights);
  const __m256i blend = _mm256_mullo_epi32(_mm256_sub_epi32(bottom, top), spots.fy);
  const __m256i sum =
      _mm256_add_epi32(_mm256_add_epi32(_mm256_slli_epi32(top, 8), blend), _mm256_set1_epi32(1 << 15));
  return _mm256_srli_epi32(sum, 16);
}

/// As the low bytes of the result.
CAIRN_AVX2 CAIRN_INLINE __m128i bytes_avx2(__m256i values) {
  const __m128i words = _mm_packus_epi32(_mm256_castsi256_si128(values), _mm256_extracti128_si256(values, 1));
  return _mm_packus_epi16(words, words);
}

/// Samples a patch as it is.
struct SinglePixels {
  const SourcePatch& source;

  CAIRN_AVX2 CAIRN_INLINE __m128i sample(__m256i u, __m256i v) const {
    const Spots spots = spots_avx2(u, v);
    // A gather takes four bytes of which two are wanted: the first two in the upper row, the last two in the
    // lower, so that neither reads beyond the patch.
    const auto* upper = reinterpret_cast<const int*>(source.data());
    const auto* lower = reinterpret_cast<const int*>(source.data() + kSourcePatchSize - 2);
    return bytes_avx2(blend_avx2(spots, _mm256_i32gather_epi32(upper, spots.index, 1),
                                 _mm256_i32gather_epi32(lower, spots.index, 1)));
  }
};

/// The ways from the middle of a smear to its samples, in 16.16 fixed point.
struct SmearWays {
  static constexpr size_t kMost = kSourcePatchSize;
  std::array<int, kMost> u;
  std::array<int, kMost> v;
  size_t count = 0;

  /// The mean of so many values, rounded; exact for their sums.
  [[nodiscard]] int half() const { return static_cast<int>(count / 2); }
  [[nodiscard]] int reciprocal() const { return static_cast<int>((0xFFFFU + count) / count); }
};

/// Samples a patch all along a smear, and the mean is a sample. One gather finds all that goes into a value,
/// since each pixel is put together with the one to its right and the two below: that pays where there are
/// more samples than one.
struct SmearedPixels {
  alignas(64) std::array<uint8_t, 4 * kSourcePatchPixels> quads;
  const SmearWays& ways;

  CAIRN_AVX2 SmearedPixels(const SourcePatch& source, const SmearWays& smear_ways) : ways(smear_ways) {
    constexpr size_t kBlock = 16;
    constexpr size_t kBelow = kSourcePatchSize;
    constexpr size_t kLast = kSourcePatchPixels - kBelow - 1 - kBlock;  // reads up to the end of the patch
    for (size_t begin = 0; begin < kLast + kBlock; begin += kBlock) {
      const size_t i = std::min(begin, kLast);
      const auto at = [&](size_t k) { return _mm_loadu_si128(vector_at(source.data() + k)); };
      const __m128i here = at(i);
      const __m128i right = at(i + 1);
      const __m128i below = at(i + kBelow);
      const __m128i beside = at(i + kBelow + 1);
      auto* out = reinterpret_cast<__m128i*>(quads.data() + 4 * i);
      const __m128i upper_low = _mm_unpacklo_epi8(here, right);
      const __m128i upper_high = _mm_unpackhi_epi8(here, right);
      const __m128i lower_low = _mm_unpacklo_epi8(below, beside);
      const __m128i lower_high = _mm_unpackhi_epi8(below, beside);
      _mm_storeu_si128(out, _mm_unpacklo_epi16(upper_low, lower_low));
      _mm_storeu_si128(out + 1, _mm_unpackhi_epi16(upper_low, lower_low));
      _mm_storeu_si128(out + 2, _mm_unpacklo_epi16(upper_high, lower_high));
      _mm_storeu_si128(out + 3, _mm_unpackhi_epi16(upper_high, lower_high));
    }
  }

  CAIRN_AVX2 CAIRN_INLINE __m128i sample(__m256i u, __m256i v) const {
    __m256i sum = _mm256_set1_epi32(ways.half());
    for (size_t k = 0; k < ways.count; ++k) {
      const Spots spots = spots_avx2(_mm256_add_epi32(u, _mm256_set1_epi32(ways.u[k])),
                                     _mm256_add_epi32(v, _mm256_set1_epi32(ways.v[k])));
      const __m256i quad = _mm256_i32gather_epi32(reinterpret_cast<const int*>(quads.data()), spots.index, 4);
      sum = _mm256_add_epi32(sum, blend_avx2(spots, quad, quad));
    }
    return bytes_avx2(_mm256_srli_epi32(_mm256_mullo_epi32(sum, _mm256_set1_epi32(ways.reciprocal())), 16));
  }
};

template <class Pixels>
CAIRN_AVX2 CAIRN_INLINE void warp_avx2(const Pixels& source, const SampleGrid& grid, RingedTemplate* out) {
  const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  // The columns to the left and right first: the row loads of the gradients then find the rows stored last.
  const __m256i u_along_j = _mm256_mullo_epi32(lane, _mm256_set1_epi32(grid.u_per_j));
  const __m256i v_along_j = _mm256_mullo_epi32(lane, _mm256_set1_epi32(grid.v_per_j));
  for (const int i : {-1, kTemplateSize}) {
    alignas(16) std::array<uint8_t, 16> column;
    _mm_store_si128(reinterpret_cast<__m128i*>(column.data()),
                    source.sample(_mm256_add_epi32(_mm256_set1_epi32(grid.u(i, 0)), u_along_j),
                                  _mm256_add_epi32(_mm256_set1_epi32(grid.v(i, 0)), v_along_j)));
    for (int j = 0; j < kTemplateSize; ++j) *out->at(i, j) = column[static_cast<size_t>(j)];
  }
  const __m256i u_along_i = _mm256_mullo_epi32(lane, _mm256_set1_epi32(grid.u_per_i));
  const __m256i v_along_i = _mm256_mullo_epi32(lane, _mm256_set1_epi32(grid.v_per_i));
  for (int j = -1; j <= kTemplateSize; ++j) {
    _mm_storel_epi64(reinterpret_cast<__m128i*>(out->at(0, j)),
                     source.sample(_mm256_add_epi32(_mm256_set1_epi32(grid.u(0, j)), u_along_i),
                                   _mm256_add_epi32(_mm256_set1_epi32(grid.v(0, j)), v_along_i)));
  }
}

CAIRN_AVX2 void warp_single_avx2(const SourcePatch& source, const SampleGrid& grid, RingedTemplate* out) {
  warp_avx2(SinglePixels{source}, grid, out);
}

CAIRN_AVX2 void warp_smeared_avx2(const SourcePatch& source, const SampleGrid& grid, const SmearWays& ways,
                                  RingedTemplate* out) {
  warp_avx2(SmearedPixels(source, ways), grid, out);
}

/// To the samples of a smear of this way [template px], the middle of which is `aside`.
SmearWays smear_ways(const SampleGrid& grid, const Eigen::Vector2f& along, const Eigen::Vector2f& aside) {
  // One for each pixel and a half, which interpolation bridges, and spread so that their variance is that of
  // the whole way.
  constexpr float kPart = 1.5F;
  SmearWays ways;
  ways.count = static_cast<size_t>(std::ceil(along.norm() / kPart)) + 1;
  const auto n = static_cast<float>(ways.count);
  const float spread = ways.count == 1 ? 0 : 1 / std::sqrt(n * n - 1);
  for (size_t k = 0; k < ways.count; ++k) {
    const float part = spread * (static_cast<float>(k) - 0.5F * (n - 1));
    const SampleGrid there = grid.moved(aside.x() + part * along.x(), aside.y() + part * along.y());
    ways.u[k] = there.u_origin - grid.u_origin;
    ways.v[k] = there.v_origin - grid.v_origin;
  }
  return ways;
}

/// Where each sample of a smear shows the patch, one after the other.
void warp_smeared_scalar(const SourcePatch& source, const SampleGrid& grid, const SmearWays& ways,
                         RingedTemplate* out) {
  std::array<int, RingedTemplate::kPixels> sums{};
  for (size_t k = 0; k < ways.count; ++k) {
    SampleGrid there = grid;
    there.u_origin += ways.u[k];
    there.v_origin += ways.v[k];
    warp_scalar(source, there, out);
    for (size_t i = 0; i < sums.size(); ++i) sums[i] += out->pixels[i];
  }
  for (size_t i = 0; i < sums.size(); ++i)
    out->pixels[i] = static_cast<uint8_t>((sums[i] + ways.half()) * ways.reciprocal() >> 16);
}

/// Sums over the template of products of its gradients (unhalved) and itself.
struct TemplateSums {
  int x = 0;
  int y = 0;
  int xx = 0;
  int xy = 0;
  int yy = 0;
  int value = 0;
  int value_squared = 0;
};

CAIRN_INLINE int sum_of_lanes(__m128i v) {
  v = _mm_add_epi32(v, _mm_unpackhi_epi64(v, v));
  return _mm_cvtsi128_si32(_mm_add_epi32(v, _mm_srli_si128(v, 4)));
}

/// Pixels and gradients into the template. SSE2 suffices: eight rows of eight.
TemplateSums fill_template(const RingedTemplate& ringed, PatchTemplate* out) {
  const __m128i zero = _mm_setzero_si128();
  const __m128i ones = _mm_set1_epi16(1);
  __m128i x = zero;
  __m128i y = zero;
  __m128i xx = zero;
  __m128i xy = zero;
  __m128i yy = zero;
  __m128i value = zero;
  __m128i value_squared = zero;
  const auto row = [&](int i, int j) {
    return _mm_unpacklo_epi8(_mm_loadl_epi64(vector_at(ringed.at(i, j))), zero);
  };
  __m128i above = row(0, -1);
  __m128i here = row(0, 0);
  for (int j = 0; j < kTemplateSize; ++j) {
    const auto offset = static_cast<size_t>(j) * kTemplateSize;
    const __m128i below = row(0, j + 1);
    const __m128i gx = _mm_sub_epi16(row(1, j), row(-1, j));
    const __m128i gy = _mm_sub_epi16(below, above);
    _mm_storel_epi64(reinterpret_cast<__m128i*>(out->pixels.data() + offset), _mm_packus_epi16(here, here));
    _mm_store_si128(reinterpret_cast<__m128i*>(out->gradient_x.data() + offset), gx);
    _mm_store_si128(reinterpret_cast<__m128i*>(out->gradient_y.data() + offset), gy);
    x = _mm_add_epi16(x, gx);
    y = _mm_add_epi16(y, gy);
    value = _mm_add_epi16(value, here);
    xx = _mm_add_epi32(xx, _mm_madd_epi16(gx, gx));
    xy = _mm_add_epi32(xy, _mm_madd_epi16(gx, gy));
    yy = _mm_add_epi32(yy, _mm_madd_epi16(gy, gy));
    value_squared = _mm_add_epi32(value_squared, _mm_madd_epi16(here, here));
    above = here;
    here = below;
  }
  return {.x = sum_of_lanes(_mm_madd_epi16(x, ones)),
          .y = sum_of_lanes(_mm_madd_epi16(y, ones)),
          .xx = sum_of_lanes(xx),
          .xy = sum_of_lanes(xy),
          .yy = sum_of_lanes(yy),
          .value = sum_of_lanes(_mm_madd_epi16(value, ones)),
          .value_squared = sum_of_lanes(value_squared)};
}

/// Inverse of the normal matrix of (x, y, mean), rows of the Jacobian being (gx / 2, gy / 2, 1), by
/// eliminating the mean. Flat when the gradient across the weakest direction varies by less than one grey
/// level (unhalved): then what moves the estimate is noise.
void invert_hessian(const TemplateSums& s, PatchTemplate* out) {
  constexpr double kMinVariance = 1.0;
  const double n = kPixels;
  // n^2 times the covariance of the unhalved gradient.
  const double cxx = n * s.xx - static_cast<double>(s.x) * s.x;
  const double cxy = n * s.xy - static_cast<double>(s.x) * s.y;
  const double cyy = n * s.yy - static_cast<double>(s.y) * s.y;
  const double determinant = cxx * cyy - cxy * cxy;
  out->flat = determinant <=
              kMinVariance * n * n * (cxx + cyy);  // determinant / trace: the smaller eigenvalue, nearly
  out->inverse_hessian.setZero();
  if (out->flat) return;
  const double scale = 4 * n / determinant;
  Eigen::Matrix2d block;
  block << scale * cyy, -scale * cxy, -scale * cxy, scale * cxx;
  const Eigen::Vector2d mean_gradient(0.5 * s.x / n, 0.5 * s.y / n);
  const Eigen::Vector2d cross = -block * mean_gradient;
  out->inverse_hessian.topLeftCorner<2, 2>() = block.cast<float>();
  out->inverse_hessian.topRightCorner<2, 1>() = cross.cast<float>();
  out->inverse_hessian.bottomLeftCorner<1, 2>() = cross.transpose().cast<float>();
  out->inverse_hessian(2, 2) = static_cast<float>(1 / n - cross.dot(mean_gradient));
}

void finish_template(const RingedTemplate& ringed, int level, PatchTemplate* out) {
  const TemplateSums sums = fill_template(ringed, out);
  out->sum = sums.value;
  out->sum_squares = sums.value_squared;
  out->level = level;
  invert_hessian(sums, out);
}

}  // namespace

bool cut_source_patch(const GrayView& image, Corner corner, SourcePatch* out) {
  const int x = corner.x - kSourceCenter;
  const int y = corner.y - kSourceCenter;
  if (x < 0 || y < 0 || x + kSourcePatchSize > image.width || y + kSourcePatchSize > image.height)
    return false;
  for (int j = 0; j < kSourcePatchSize; ++j) {
    std::memcpy(out->data() + static_cast<size_t>(j) * kSourcePatchSize, image.row(y + j) + x,
                kSourcePatchSize);
  }
  return true;
}

std::optional<int> warp_level(const Warp& level0_from_source) {
  float area = level0_from_source.determinant();
  int level = 0;
  while (area > kMaxArea && level < kPyramidLevels - 1) {
    area *= 0.25F;
    ++level;
  }
  if (!(area > kMinArea && area < kMaxArea)) return std::nullopt;
  return level;
}

bool kernels::make_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                            PatchTemplate* out, Simd simd) {
  const std::optional<SampleGrid> grid = sample_grid(level0_from_source, level);
  if (!grid) return false;
  RingedTemplate ringed;
  if (simd == Simd::kAvx2) {
    warp_single_avx2(source, *grid, &ringed);
  } else {
    warp_scalar(source, *grid, &ringed);
  }
  finish_template(ringed, level, out);
  return true;
}

bool make_template(const SourcePatch& source, const Warp& level0_from_source, int level, PatchTemplate* out) {
  return kernels::make_template(source, level0_from_source, level, out, best_simd());
}

bool kernels::make_smeared_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                                    const Eigen::Vector2f& smear, const Eigen::Vector2f& aside,
                                    PatchTemplate* out, Simd simd) {
  constexpr auto kLongest = static_cast<float>(SmearWays::kMost);
  const std::optional<SampleGrid> grid = sample_grid(level0_from_source, level);
  Eigen::Vector2f along = smear / static_cast<float>(1 << level);
  if (!grid || !along.allFinite()) return false;
  const auto fits = [&] {
    return along.norm() < kLongest && grid->moved(along.x() / 2, along.y() / 2).is_inside() &&
           grid->moved(-along.x() / 2, -along.y() / 2).is_inside();
  };
  while (!fits()) along *= 0.8F;
  const SmearWays ways = smear_ways(*grid, along, aside);
  RingedTemplate ringed;
  if (simd == Simd::kAvx2) {
    warp_smeared_avx2(source, *grid, ways, &ringed);
  } else {
    warp_smeared_scalar(source, *grid, ways, &ringed);
  }
  finish_template(ringed, level, out);
  return true;
}

bool make_smeared_template(const SourcePatch& source, const Warp& level0_from_source, int level,
                           const Eigen::Vector2f& smear, const Eigen::Vector2f& aside, PatchTemplate* out) {
  return kernels::make_smeared_template(source, level0_from_source, level, smear, aside, out, best_simd());
}

}  // namespace cairn
