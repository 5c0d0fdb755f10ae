// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>

#include "common/image/kernels.h"

namespace cairn {
namespace {

constexpr int kHalf = kTemplateSize / 2;
constexpr int kPixels = kTemplateSize * kTemplateSize;

/// Sums over the template of the residual r = image - template, and of its products with the unhalved
/// gradients.
struct ResidualSums {
  float xr = 0;
  float yr = 0;
  float r = 0;
  float rr = 0;

  /// Zero-mean SSD at the position where these were taken.
  [[nodiscard]] float zmssd() const { return rr - r * r / kPixels; }
};

/// Weights of the four neighbours of a sub-pixel position (Keys, ICASSP 1981: the cubic with a = -1/2).
using CubicWeights = std::array<float, 4>;

/// The weights of cubic convolution at a position: its four polynomials, a lane each.
CAIRN_INLINE CubicWeights cubic_weights(float position) {
  F32x4 w = F32x4{-0.5F, 1.5F, -1.5F, 0.5F} * position;
  w = (w + F32x4{1.0F, -2.5F, 2.0F, -0.5F}) * position;
  w = (w + F32x4{-0.5F, 0.0F, 0.5F, 0.0F}) * position;
  CubicWeights weights;
  store_lanes(weights.data(), w + F32x4{0.0F, 1.0F, 0.0F, 0.0F});
  return weights;
}

/// An 8x8 window of an image at a sub-pixel position, sampled by cubic convolution. Bilinear samples would be
/// blurred by how far they lie from a pixel, which the template is not: that pulls the estimate by 0.05 px
/// (README.md).
///
/// Column i of a sum is lane i in every variant, and the lanes are added up as ((0+4)+(2+6)) + ((1+5)+(3+7)):
/// the variants agree to the bit.
struct Window {
  const uint8_t* pixels;  ///< upper left pixel of the 11x11 that are read
  ptrdiff_t stride;
  CubicWeights across;
  CubicWeights down;
};

using Lanes = std::array<float, kTemplateSize>;

float sum_of_columns(const Lanes& l) {
  return ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]));
}

ResidualSums residual_sums_scalar(const PatchTemplate& patch, const Window& window) {
  Lanes xr{};
  Lanes yr{};
  Lanes sum{};
  Lanes rr{};
  const auto blend = [](const CubicWeights& w, float a, float b, float c, float d) {
    return (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
  };
  const auto across = [&](int j, int i) {
    const uint8_t* p = window.pixels + j * window.stride + i;
    return blend(window.across, p[0], p[1], p[2], p[3]);
  };
  for (int j = 0; j < kTemplateSize; ++j) {
    for (int i = 0; i < kTemplateSize; ++i) {
      const auto lane = static_cast<size_t>(i);
      const size_t k = static_cast<size_t>(j) * kTemplateSize + lane;
      const float value =
          blend(window.down, across(j, i), across(j + 1, i), across(j + 2, i), across(j + 3, i));
      const float r = value - static_cast<float>(patch.pixels[k]);
      xr[lane] += static_cast<float>(patch.gradient_x[k]) * r;
      yr[lane] += static_cast<float>(patch.gradient_y[k]) * r;
      sum[lane] += r;
      rr[lane] += r * r;
    }
  }
  return {sum_of_columns(xr), sum_of_columns(yr), sum_of_columns(sum), sum_of_columns(rr)};
}

// The narrow variant takes the columns in two halves; the sums of a lane do not notice.

CAIRN_INLINE F32x4 blend(const CubicWeights& w, F32x4 a, F32x4 b, F32x4 c, F32x4 d) {
  return (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
}
CAIRN_INLINE F32x4 across_narrow(const Window& window, int j, int i) {
  const uint8_t* p = window.pixels + j * window.stride + i;
  return blend(window.across, bytes_to_f32x4(p), bytes_to_f32x4(p + 1), bytes_to_f32x4(p + 2),
               bytes_to_f32x4(p + 3));
}

/// Sums of columns i .. i + 3, a lane each.
struct HalfSums {
  F32x4 xr{};
  F32x4 yr{};
  F32x4 r{};
  F32x4 rr{};
};

CAIRN_INLINE HalfSums half_sums(const PatchTemplate& patch, const Window& window, int i) {
  HalfSums sums;
  F32x4 a = across_narrow(window, 0, i);
  F32x4 b = across_narrow(window, 1, i);
  F32x4 c = across_narrow(window, 2, i);
  for (int j = 0; j < kTemplateSize; ++j) {
    const auto k = static_cast<size_t>(j) * kTemplateSize + static_cast<size_t>(i);
    const F32x4 d = across_narrow(window, j + 3, i);
    const F32x4 r = blend(window.down, a, b, c, d) - bytes_to_f32x4(patch.pixels.data() + k);
    sums.xr += words_to_f32x4(patch.gradient_x.data() + k) * r;
    sums.yr += words_to_f32x4(patch.gradient_y.data() + k) * r;
    sums.r += r;
    sums.rr += r * r;
    a = b;
    b = c;
    c = d;
  }
  return sums;
}

ResidualSums residual_sums_narrow(const PatchTemplate& patch, const Window& window) {
  const HalfSums left = half_sums(patch, window, 0);
  const HalfSums right = half_sums(patch, window, 4);
  return {sum_of_lanes(left.xr + right.xr), sum_of_lanes(left.yr + right.yr), sum_of_lanes(left.r + right.r),
          sum_of_lanes(left.rr + right.rr)};
}

CAIRN_WIDE CAIRN_INLINE F32x8 blend(const CubicWeights& w, F32x8 a, F32x8 b, F32x8 c, F32x8 d) {
  return (w[0] * a + w[1] * b) + (w[2] * c + w[3] * d);
}
CAIRN_WIDE CAIRN_INLINE F32x8 across_wide(const Window& window, int j) {
  const uint8_t* p = window.pixels + j * window.stride;
  const F32x8 first = bytes_to_f32x8(p);     // pixels 0 1 2 3 | 4 5 6 7
  const F32x8 last = bytes_to_f32x8(p + 3);  //        3 4 5 6 | 7 8 9 10
  return blend(window.across, first, CAIRN_LANES(first, last, 1, 2, 8, 9, 5, 6, 12, 13),
               CAIRN_LANES(first, last, 2, 3, 9, 10, 6, 7, 13, 14), last);
}
CAIRN_WIDE CAIRN_INLINE float sum_of_eight(F32x8 v) {
  return sum_of_lanes(lower_half(v) + upper_half(v));
}

CAIRN_WIDE ResidualSums residual_sums_wide(const PatchTemplate& patch, const Window& window) {
  F32x8 xr{};
  F32x8 yr{};
  F32x8 sum{};
  F32x8 rr{};
  F32x8 a = across_wide(window, 0);
  F32x8 b = across_wide(window, 1);
  F32x8 c = across_wide(window, 2);
#pragma GCC unroll 8
  for (int j = 0; j < kTemplateSize; ++j) {
    const size_t k = static_cast<size_t>(j) * kTemplateSize;
    const F32x8 d = across_wide(window, j + 3);
    const F32x8 r = blend(window.down, a, b, c, d) - bytes_to_f32x8(patch.pixels.data() + k);
    xr += words_to_f32x8(patch.gradient_x.data() + k) * r;
    yr += words_to_f32x8(patch.gradient_y.data() + k) * r;
    sum += r;
    rr += r * r;
    a = b;
    b = c;
    c = d;
  }
  return {sum_of_eight(xr), sum_of_eight(yr), sum_of_eight(sum), sum_of_eight(rr)};
}

CAIRN_INLINE ResidualSums residual_sums(const PatchTemplate& patch, const Window& window, Simd simd) {
  switch (simd) {
    case Simd::kWide:
      return residual_sums_wide(patch, window);
    case Simd::kNarrow:
      return residual_sums_narrow(patch, window);
    case Simd::kScalar:
      break;
  }
  return residual_sums_scalar(patch, window);
}

/// The first two rows of the inverse Hessian times the gradient, written out: Eigen adds up the three
/// products of a row in another order where a processor has vectors of two floats (NEON) than where it has
/// not (SSE).
CAIRN_INLINE Eigen::Vector2f newton_step(const Eigen::Matrix3f& inverse_hessian, const ResidualSums& sums) {
  const float x = 0.5F * sums.xr;
  const float y = 0.5F * sums.yr;
  const auto row = [&](int i) {
    return inverse_hessian(i, 0) * x + (inverse_hessian(i, 1) * y + inverse_hessian(i, 2) * sums.r);
  };
  return {row(0), row(1)};
}

/// The window whose template pixel (4, 4) lies at (x, y); false unless its 11x11 pixels are in the image.
CAIRN_INLINE bool place_window(const GrayView& image, const Eigen::Vector2f& position, Window* out) {
  // Compared as floats first: a diverged position may not fit an int, and NaN is inside of nothing.
  if (!image.contains(position.x(), position.y(), kHalf + 1)) return false;
  const int x = static_cast<int>(position.x());
  const int y = static_cast<int>(position.y());
  out->pixels = image.row(y - kHalf - 1) + x - kHalf - 1;
  out->stride = image.stride;
  out->across = cubic_weights(position.x() - static_cast<float>(x));
  out->down = cubic_weights(position.y() - static_cast<float>(y));
  return true;
}

}  // namespace

std::optional<Eigen::Vector2f> kernels::refine_patch(const PatchTemplate& patch, const GrayView& level_image,
                                                     const Eigen::Vector2f& start, int max_iterations,
                                                     float max_shift, int max_zmssd, Simd simd) {
  constexpr float kConverged = 0.03F;  // px
  if (patch.flat) return std::nullopt;
  Eigen::Vector2f position = start;
  Window window;
  bool is_inside = place_window(level_image, position, &window);
  for (int iteration = 0; is_inside && iteration < max_iterations; ++iteration) {
    const ResidualSums sums = residual_sums(patch, window, simd);
    const Eigen::Vector2f step = newton_step(patch.inverse_hessian, sums);
    position -= step;
    if (!((position - start).squaredNorm() <= max_shift * max_shift)) return std::nullopt;
    is_inside = place_window(level_image, position, &window);
    if (step.squaredNorm() >= kConverged * kConverged) continue;
    if (!is_inside) return std::nullopt;
    if (residual_sums(patch, window, simd).zmssd() > static_cast<float>(max_zmssd)) return std::nullopt;
    return position;
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2f> refine_patch(const PatchTemplate& patch, const GrayView& level_image,
                                            const Eigen::Vector2f& start, int max_iterations, float max_shift,
                                            int max_zmssd) {
  return kernels::refine_patch(patch, level_image, start, max_iterations, max_shift, max_zmssd, best_simd());
}

float sample_bilinear(const GrayView& image, float x, float y) {
  const int ix = static_cast<int>(x);
  const int iy = static_cast<int>(y);
  const float fx = x - static_cast<float>(ix);
  const float fy = y - static_cast<float>(iy);
  const uint8_t* top = image.row(iy) + ix;
  const uint8_t* bottom = top + image.stride;
  const float above = static_cast<float>(top[0]) + fx * static_cast<float>(top[1] - top[0]);
  const float below = static_cast<float>(bottom[0]) + fx * static_cast<float>(bottom[1] - bottom[0]);
  return above + fy * (below - above);
}

}  // namespace cairn
