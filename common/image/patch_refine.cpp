// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>
#include <cstring>

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

/// Its four polynomials, a lane each.
CAIRN_INLINE CubicWeights cubic_weights(float position) {
  const __m128 t = _mm_set1_ps(position);
  __m128 w = _mm_mul_ps(_mm_setr_ps(-0.5F, 1.5F, -1.5F, 0.5F), t);
  w = _mm_mul_ps(_mm_add_ps(w, _mm_setr_ps(1.0F, -2.5F, 2.0F, -0.5F)), t);
  w = _mm_mul_ps(_mm_add_ps(w, _mm_setr_ps(-0.5F, 0.0F, 0.5F, 0.0F)), t);
  CubicWeights weights;
  _mm_storeu_ps(weights.data(), _mm_add_ps(w, _mm_setr_ps(0.0F, 1.0F, 0.0F, 0.0F)));
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

float sum_of_lanes(const Lanes& l) {
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
  return {sum_of_lanes(xr), sum_of_lanes(yr), sum_of_lanes(sum), sum_of_lanes(rr)};
}

// The SSE2 variant takes the columns in two halves; the sums of a lane do not notice.

CAIRN_INLINE __m128 bytes_to_floats(const uint8_t* p) {  // four
  int32_t bytes = 0;
  std::memcpy(&bytes, p, sizeof(bytes));
  const __m128i zero = _mm_setzero_si128();
  return _mm_cvtepi32_ps(_mm_unpacklo_epi16(_mm_unpacklo_epi8(_mm_cvtsi32_si128(bytes), zero), zero));
}
CAIRN_INLINE __m128 words_to_floats(const int16_t* p) {  // four
  const __m128i words = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(p));
  return _mm_cvtepi32_ps(_mm_unpacklo_epi16(words, _mm_srai_epi16(words, 15)));
}
CAIRN_INLINE __m128 blend(const CubicWeights& w, __m128 a, __m128 b, __m128 c, __m128 d) {
  return _mm_add_ps(_mm_add_ps(_mm_mul_ps(_mm_set1_ps(w[0]), a), _mm_mul_ps(_mm_set1_ps(w[1]), b)),
                    _mm_add_ps(_mm_mul_ps(_mm_set1_ps(w[2]), c), _mm_mul_ps(_mm_set1_ps(w[3]), d)));
}
CAIRN_INLINE __m128 across_sse2(const Window& window, int j, int i) {
  const uint8_t* p = window.pixels + j * window.stride + i;
  return blend(window.across, bytes_to_floats(p), bytes_to_floats(p + 1), bytes_to_floats(p + 2),
               bytes_to_floats(p + 3));
}
CAIRN_INLINE float sum_of_lanes(__m128 low_plus_high) {
  const __m128 pairs = _mm_add_ps(low_plus_high, _mm_movehl_ps(low_plus_high, low_plus_high));
  return _mm_cvtss_f32(_mm_add_ss(pairs, _mm_shuffle_ps(pairs, pairs, 1)));
}

/// Sums of columns i .. i + 3, a lane each.
struct HalfSums {
  __m128 xr = _mm_setzero_ps();
  __m128 yr = _mm_setzero_ps();
  __m128 r = _mm_setzero_ps();
  __m128 rr = _mm_setzero_ps();
};

CAIRN_INLINE HalfSums half_sums(const PatchTemplate& patch, const Window& window, int i) {
  HalfSums sums;
  __m128 a = across_sse2(window, 0, i);
  __m128 b = across_sse2(window, 1, i);
  __m128 c = across_sse2(window, 2, i);
  for (int j = 0; j < kTemplateSize; ++j) {
    const auto k = static_cast<size_t>(j) * kTemplateSize + static_cast<size_t>(i);
    const __m128 d = across_sse2(window, j + 3, i);
    const __m128 r = _mm_sub_ps(blend(window.down, a, b, c, d), bytes_to_floats(patch.pixels.data() + k));
    sums.xr = _mm_add_ps(sums.xr, _mm_mul_ps(words_to_floats(patch.gradient_x.data() + k), r));
    sums.yr = _mm_add_ps(sums.yr, _mm_mul_ps(words_to_floats(patch.gradient_y.data() + k), r));
    sums.r = _mm_add_ps(sums.r, r);
    sums.rr = _mm_add_ps(sums.rr, _mm_mul_ps(r, r));
    a = b;
    b = c;
    c = d;
  }
  return sums;
}

ResidualSums residual_sums_sse2(const PatchTemplate& patch, const Window& window) {
  const HalfSums left = half_sums(patch, window, 0);
  const HalfSums right = half_sums(patch, window, 4);
  return {sum_of_lanes(_mm_add_ps(left.xr, right.xr)), sum_of_lanes(_mm_add_ps(left.yr, right.yr)),
          sum_of_lanes(_mm_add_ps(left.r, right.r)), sum_of_lanes(_mm_add_ps(left.rr, right.rr))};
}

CAIRN_AVX2 CAIRN_INLINE __m256 words_to_floats_avx2(const int16_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepi16_epi32(_mm_load_si128(reinterpret_cast<const __m128i*>(p))));
}
CAIRN_AVX2 CAIRN_INLINE __m256 bytes_to_floats_avx2(const uint8_t* p) {
  return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64(vector_at(p))));
}
CAIRN_AVX2 CAIRN_INLINE __m256 blend_avx2(const CubicWeights& w, __m256 a, __m256 b, __m256 c, __m256 d) {
  return _mm256_add_ps(
      _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(w[0]), a), _mm256_mul_ps(_mm256_set1_ps(w[1]), b)),
      _mm256_add_ps(_mm256_mul_ps(_mm256_set1_ps(w[2]), c), _mm256_mul_ps(_mm256_set1_ps(w[3]), d)));
}
CAIRN_AVX2 CAIRN_INLINE __m256 across_avx2(const Window& window, int j) {
  const uint8_t* p = window.pixels + j * window.stride;
  const __m256 first = bytes_to_floats_avx2(p);     // pixels 0 1 2 3 | 4 5 6 7
  const __m256 last = bytes_to_floats_avx2(p + 3);  //        3 4 5 6 | 7 8 9 10
  return blend_avx2(window.across, first, _mm256_shuffle_ps(first, last, _MM_SHUFFLE(1, 0, 2, 1)),
                    _mm256_shuffle_ps(first, last, _MM_SHUFFLE(2, 1, 3, 2)), last);
}
CAIRN_AVX2 CAIRN_INLINE float sum_of_lanes_avx2(__m256 v) {
  return sum_of_lanes(_mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1)));
}

CAIRN_AVX2 ResidualSums residual_sums_avx2(const PatchTemplate& patch, const Window& window) {
  __m256 xr = _mm256_setzero_ps();
  __m256 yr = _mm256_setzero_ps();
  __m256 sum = _mm256_setzero_ps();
  __m256 rr = _mm256_setzero_ps();
  __m256 a = across_avx2(window, 0);
  __m256 b = across_avx2(window, 1);
  __m256 c = across_avx2(window, 2);
#pragma GCC unroll 8
  for (int j = 0; j < kTemplateSize; ++j) {
    const size_t k = static_cast<size_t>(j) * kTemplateSize;
    const __m256 d = across_avx2(window, j + 3);
    const __m256 r =
        _mm256_sub_ps(blend_avx2(window.down, a, b, c, d), bytes_to_floats_avx2(patch.pixels.data() + k));
    xr = _mm256_add_ps(xr, _mm256_mul_ps(words_to_floats_avx2(patch.gradient_x.data() + k), r));
    yr = _mm256_add_ps(yr, _mm256_mul_ps(words_to_floats_avx2(patch.gradient_y.data() + k), r));
    sum = _mm256_add_ps(sum, r);
    rr = _mm256_add_ps(rr, _mm256_mul_ps(r, r));
    a = b;
    b = c;
    c = d;
  }
  return {sum_of_lanes_avx2(xr), sum_of_lanes_avx2(yr), sum_of_lanes_avx2(sum), sum_of_lanes_avx2(rr)};
}

CAIRN_INLINE ResidualSums residual_sums(const PatchTemplate& patch, const Window& window, Simd simd) {
  switch (simd) {
    case Simd::kAvx2:
      return residual_sums_avx2(patch, window);
    case Simd::kSse2:
      return residual_sums_sse2(patch, window);
    case Simd::kScalar:
      break;
  }
  return residual_sums_scalar(patch, window);
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
    const Eigen::Vector3f gradient(0.5F * sums.xr, 0.5F * sums.yr, sums.r);
    const Eigen::Vector2f step = patch.inverse_hessian.topRows<2>() * gradient;
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
