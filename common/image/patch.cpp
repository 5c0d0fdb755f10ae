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
  /// Where the reference pixel lies. Bilinear weights have 8 bits: the rounding is done here, once, instead
  /// of at every sample.
  int u_origin = kSourceCenter * kOne + (1 << (kFractionBits - 9));
  int v_origin = u_origin;

  [[nodiscard]] int u(int i, int j) const { return u_origin + u_per_i * (i - kHalf) + u_per_j * (j - kHalf); }
  [[nodiscard]] int v(int i, int j) const { return v_origin + v_per_i * (i - kHalf) + v_per_j * (j - kHalf); }
  /// The grid of a template that lies (x, y) [template px] away.
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
    return round_to_int(source_from_target(row, column) * static_cast<float>(kOne));
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

/// Places of eight samples: the pixel to the upper left of each, and how far [1/256 px] they are from it.
struct Spots {
  I32x8 index;
  I32x8 fx;
  I32x8 fy;
};

CAIRN_WIDE CAIRN_INLINE I32x8 clamped(I32x8 v) {
  return smaller(larger(v, I32x8{}), I32x8{} + kMaxCoordinate);
}

CAIRN_WIDE CAIRN_INLINE Spots spots_at(I32x8 u, I32x8 v) {
  u = clamped(u);
  v = clamped(v);
  // The high halves of the lanes are 0: products of 16 bits are faster and the same.
  const I32x8 row = (I32x8)((I16x16)(v >> kFractionBits) * static_cast<int16_t>(kSourcePatchSize));
  return {row + (u >> kFractionBits), (u >> 8) & 255, (v >> 8) & 255};
}

/// The values of eight samples, from the two bytes at the begin of `top` and the two at the end of `bottom`.
CAIRN_WIDE CAIRN_INLINE I32x8 blend(const Spots& spots, I32x8 top_bytes, I32x8 bottom_bytes) {
  constexpr uint8_t kNone = 255;
  const I16x16 weights = (I16x16)((spots.fx << 16) | (256 - spots.fx));
  const U8x32 first_two = {0, kNone, 1, kNone, 4, kNone, 5, kNone, 8, kNone, 9, kNone, 12, kNone, 13, kNone,
                           0, kNone, 1, kNone, 4, kNone, 5, kNone, 8, kNone, 9, kNone, 12, kNone, 13, kNone};
  const U8x32 last_two = {2, kNone, 3, kNone, 6, kNone, 7, kNone, 10, kNone, 11, kNone, 14, kNone, 15, kNone,
                          2, kNone, 3, kNone, 6, kNone, 7, kNone, 10, kNone, 11, kNone, 14, kNone, 15, kNone};
  const I32x8 top = multiply_add_pairs((I16x16)pick_bytes((U8x32)top_bytes, first_two), weights);
  const I32x8 bottom = multiply_add_pairs((I16x16)pick_bytes((U8x32)bottom_bytes, last_two), weights);
  return ((top << 8) + (bottom - top) * spots.fy + (1 << 15)) >> 16;
}

/// Samples a patch as it is.
struct SinglePixels {
  const SourcePatch& source;

  CAIRN_WIDE CAIRN_INLINE I32x8 sample(I32x8 u, I32x8 v) const {
    const Spots spots = spots_at(u, v);
    // A gather takes four bytes of which two are wanted: the first two in the upper row, the last two in the
    // lower, so that neither reads beyond the patch.
    return blend(spots, gather<1>(source.data(), spots.index),
                 gather<1>(source.data() + kSourcePatchSize - 2, spots.index));
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

  CAIRN_WIDE SmearedPixels(const SourcePatch& source, const SmearWays& smear_ways) : ways(smear_ways) {
    constexpr size_t kBlock = 16;
    constexpr size_t kBelow = kSourcePatchSize;
    constexpr size_t kLast = kSourcePatchPixels - kBelow - 1 - kBlock;  // reads up to the end of the patch
    for (size_t begin = 0; begin < kLast + kBlock; begin += kBlock) {
      const size_t i = std::min(begin, kLast);
      const auto at = [&](size_t k) CAIRN_WIDE { return load_lanes<U8x16>(source.data() + k); };
      const auto zip = [](auto a, auto b, auto* low, auto* high) CAIRN_WIDE {
        if constexpr (sizeof(a[0]) == 1) {
          *low = CAIRN_LANES(a, b, 0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
          *high = CAIRN_LANES(a, b, 8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
        } else {
          *low = CAIRN_LANES(a, b, 0, 8, 1, 9, 2, 10, 3, 11);
          *high = CAIRN_LANES(a, b, 4, 12, 5, 13, 6, 14, 7, 15);
        }
      };
      std::array<U8x16, 2> upper;
      std::array<U8x16, 2> lower;
      zip(at(i), at(i + 1), &upper[0], &upper[1]);
      zip(at(i + kBelow), at(i + kBelow + 1), &lower[0], &lower[1]);
      for (size_t half = 0; half < 2; ++half) {
        std::array<U16x8, 2> both;
        zip((U16x8)upper[half], (U16x8)lower[half], &both[0], &both[1]);
        store_lanes(quads.data() + 4 * i + 32 * half, both[0]);
        store_lanes(quads.data() + 4 * i + 32 * half + 16, both[1]);
      }
    }
  }

  CAIRN_WIDE CAIRN_INLINE I32x8 sample(I32x8 u, I32x8 v) const {
    I32x8 sum = I32x8{} + ways.half();
    for (size_t k = 0; k < ways.count; ++k) {
      const Spots spots = spots_at(u + ways.u[k], v + ways.v[k]);
      const I32x8 quad = gather<4>(quads.data(), spots.index);
      sum += blend(spots, quad, quad);
    }
    return (sum * ways.reciprocal()) >> 16;
  }
};

template <class Pixels>
CAIRN_WIDE CAIRN_INLINE void warp_wide(const Pixels& source, const SampleGrid& grid, RingedTemplate* out) {
  const I32x8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
  // The columns to the left and right first: the row loads of the gradients then find the rows stored last.
  const I32x8 u_along_j = lane * grid.u_per_j;
  const I32x8 v_along_j = lane * grid.v_per_j;
  for (const int i : {-1, kTemplateSize}) {
    std::array<uint8_t, kTemplateSize> column;
    store_as_bytes(column.data(), source.sample(grid.u(i, 0) + u_along_j, grid.v(i, 0) + v_along_j));
    for (int j = 0; j < kTemplateSize; ++j) *out->at(i, j) = column[static_cast<size_t>(j)];
  }
  const I32x8 u_along_i = lane * grid.u_per_i;
  const I32x8 v_along_i = lane * grid.v_per_i;
  for (int j = -1; j <= kTemplateSize; ++j)
    store_as_bytes(out->at(0, j), source.sample(grid.u(0, j) + u_along_i, grid.v(0, j) + v_along_i));
}

CAIRN_WIDE void warp_single_wide(const SourcePatch& source, const SampleGrid& grid, RingedTemplate* out) {
  warp_wide(SinglePixels{source}, grid, out);
}

CAIRN_WIDE void warp_smeared_wide(const SourcePatch& source, const SampleGrid& grid, const SmearWays& ways,
                                  RingedTemplate* out) {
  warp_wide(SmearedPixels(source, ways), grid, out);
}

/// The offsets from `grid` to the samples of a smear: `along` is its way, `aside` its middle [template px].
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

/// Warps the patch once for each sample of a smear, one after the other, and takes the mean.
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

/// Pixels and gradients into the template: eight rows of eight.
TemplateSums fill_template(const RingedTemplate& ringed, PatchTemplate* out) {
  const I16x8 ones = I16x8{} + 1;
  I16x8 x{};
  I16x8 y{};
  I16x8 value{};
  I32x4 xx{};
  I32x4 xy{};
  I32x4 yy{};
  I32x4 value_squared{};
  const auto row = [&](int i, int j) { return bytes_to_i16x8(ringed.at(i, j)); };
  I16x8 above = row(0, -1);
  I16x8 here = row(0, 0);
  for (int j = 0; j < kTemplateSize; ++j) {
    const auto offset = static_cast<size_t>(j) * kTemplateSize;
    const I16x8 below = row(0, j + 1);
    const I16x8 gx = row(1, j) - row(-1, j);
    const I16x8 gy = below - above;
    store_as_bytes(out->pixels.data() + offset, here);
    store_lanes(out->gradient_x.data() + offset, gx);
    store_lanes(out->gradient_y.data() + offset, gy);
    x += gx;
    y += gy;
    value += here;
    xx += multiply_add_pairs(gx, gx);
    xy += multiply_add_pairs(gx, gy);
    yy += multiply_add_pairs(gy, gy);
    value_squared += multiply_add_pairs(here, here);
    above = here;
    here = below;
  }
  return {.x = sum_of_lanes(multiply_add_pairs(x, ones)),
          .y = sum_of_lanes(multiply_add_pairs(y, ones)),
          .xx = sum_of_lanes(xx),
          .xy = sum_of_lanes(xy),
          .yy = sum_of_lanes(yy),
          .value = sum_of_lanes(multiply_add_pairs(value, ones)),
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
  if (takes_wide(simd)) {
    warp_single_wide(source, *grid, &ringed);
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
  if (takes_wide(simd)) {
    warp_smeared_wide(source, *grid, ways, &ringed);
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
