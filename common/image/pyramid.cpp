// SPDX-License-Identifier: Apache-2.0
#include "common/image/pyramid.h"

#include "common/image/kernels.h"

namespace cairn {
namespace {

/// out[x] = mean of the 2x2 block at 2x for x in [begin, width).
void halve_row_scalar(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int begin, int width) {
  for (int x = begin; x < width; ++x) {
    const int sum = top[2 * x] + top[2 * x + 1] + bottom[2 * x] + bottom[2 * x + 1];
    out[x] = static_cast<uint8_t>((sum + 2) >> 2);
  }
}

void halve_row_sse2(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width) {
  const __m128i low_bytes = _mm_set1_epi16(0x00FF);
  const __m128i two = _mm_set1_epi16(2);
  const auto means_of_8 = [&](int x) {
    const __m128i t = _mm_loadu_si128(reinterpret_cast<const __m128i*>(top + 2 * x));
    const __m128i b = _mm_loadu_si128(reinterpret_cast<const __m128i*>(bottom + 2 * x));
    const __m128i even = _mm_add_epi16(_mm_and_si128(t, low_bytes), _mm_and_si128(b, low_bytes));
    const __m128i odd = _mm_add_epi16(_mm_srli_epi16(t, 8), _mm_srli_epi16(b, 8));
    return _mm_srli_epi16(_mm_add_epi16(_mm_add_epi16(even, odd), two), 2);
  };
  int x = 0;
  for (; x + 16 <= width; x += 16) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + x), _mm_packus_epi16(means_of_8(x), means_of_8(x + 8)));
  }
  halve_row_scalar(top, bottom, out, x, width);
}

/// 16 means of 32 + 32 pixels as 16-bit numbers.
CAIRN_AVX2 CAIRN_INLINE __m256i means_of_16(const uint8_t* top, const uint8_t* bottom) {
  const __m256i ones = _mm256_set1_epi8(1);
  const __m256i t = _mm256_maddubs_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(top)), ones);
  const __m256i b = _mm256_maddubs_epi16(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(bottom)), ones);
  return _mm256_srli_epi16(_mm256_add_epi16(_mm256_add_epi16(t, b), _mm256_set1_epi16(2)), 2);
}

CAIRN_AVX2 void halve_row_avx2(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width) {
  int x = 0;
  for (; x + 32 <= width; x += 32) {
    const __m256i left = means_of_16(top + 2 * x, bottom + 2 * x);
    const __m256i right = means_of_16(top + 2 * x + 32, bottom + 2 * x + 32);
    const __m256i packed = _mm256_permute4x64_epi64(_mm256_packus_epi16(left, right), 0b11'01'10'00);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + x), packed);
  }
  halve_row_scalar(top, bottom, out, x, width);
}

void halve_row(const uint8_t* top, const uint8_t* bottom, uint8_t* out, int width, Simd simd) {
  switch (simd) {
    case Simd::kAvx2:
      return halve_row_avx2(top, bottom, out, width);
    case Simd::kSse2:
      return halve_row_sse2(top, bottom, out, width);
    case Simd::kScalar:
      return halve_row_scalar(top, bottom, out, 0, width);
  }
}

}  // namespace

void kernels::halve(const GrayView& src, GrayImage* dst, Simd simd) {
  dst->resize(src.width / 2, src.height / 2);
  for (int y = 0; y < dst->height(); ++y)
    halve_row(src.row(2 * y), src.row(2 * y + 1), dst->row(y), dst->width(), simd);
}

void halve(const GrayView& src, GrayImage* dst) {
  kernels::halve(src, dst, best_simd());
}

void Pyramid::build(const GrayView& image) {
  const Simd simd = best_simd();
  GrayImage& base = levels_[0];
  GrayImage& half = levels_[1];
  base.resize(image.width, image.height);
  half.resize(image.width / 2, image.height / 2);
  // The first halving rides on the copy: the frame goes through the cache once.
  const auto row_bytes = static_cast<size_t>(image.width);
  for (int y = 0; y < image.height; ++y) {
    std::memcpy(base.row(y), image.row(y), row_bytes);
    if (y % 2 == 1) halve_row(base.row(y - 1), base.row(y), half.row(y / 2), half.width(), simd);
  }
  for (size_t l = 2; l < levels_.size(); ++l) kernels::halve(levels_[l - 1], &levels_[l], simd);
}

}  // namespace cairn
