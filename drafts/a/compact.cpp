// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/compact.h"

#include <xmmintrin.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace cairn {
namespace {

/// Row k: the k-th of `count` cosines of the orthonormal transform (DCT-II) of `size` values.
std::vector<float> cosines(int count, int size) {
  std::vector<float> table;
  table.reserve(static_cast<size_t>(count) * static_cast<size_t>(size));
  for (int k = 0; k < count; ++k) {
    const double scale = std::sqrt((k == 0 ? 1.0 : 2.0) / size);
    for (int i = 0; i < size; ++i)
      table.push_back(static_cast<float>(scale * std::cos(std::numbers::pi * k * (i + 0.5) / size)));
  }
  return table;
}

}  // namespace

Compact compact_of(const TinyImage& tiny) {
  Compact compact{};
  double sum = 0;
  for (const float v : tiny.values()) sum += static_cast<double>(v) * static_cast<double>(v);
  if (!(sum > 0)) return compact;
  const auto width = static_cast<size_t>(tiny.width());
  const std::vector<float> across = cosines(kCompactAcross, tiny.width());
  const std::vector<float> down = cosines(kCompactDown, tiny.height());
  const auto scale = static_cast<float>(1 / std::sqrt(sum));
  for (size_t y = 0; y < static_cast<size_t>(tiny.height()); ++y) {
    const float* row = tiny.values().data() + y * width;
    for (size_t u = 0; u < kCompactAcross; ++u) {
      float along = 0;
      for (size_t x = 0; x < width; ++x) along += across[u * width + x] * row[x];
      for (size_t v = 0; v < kCompactDown; ++v)
        compact[v * kCompactAcross + u] += scale * along * down[v * static_cast<size_t>(tiny.height()) + y];
    }
  }
  return compact;
}

float compact_distance(const Compact& a, const Compact& b) {
  constexpr size_t kLanes = 4;  // SSE, part of x86-64: the same sums on every machine
  __m128 even = _mm_setzero_ps();
  __m128 odd = _mm_setzero_ps();
  static_assert(kCompactSize % (2 * kLanes) == 0);
  for (size_t i = 0; i < kCompactSize; i += 2 * kLanes) {
    const __m128 d = _mm_sub_ps(_mm_loadu_ps(&a[i]), _mm_loadu_ps(&b[i]));
    const __m128 e = _mm_sub_ps(_mm_loadu_ps(&a[i + kLanes]), _mm_loadu_ps(&b[i + kLanes]));
    even = _mm_add_ps(even, _mm_mul_ps(d, d));
    odd = _mm_add_ps(odd, _mm_mul_ps(e, e));
  }
  alignas(16) float lanes[kLanes];
  _mm_store_ps(lanes, _mm_add_ps(even, odd));
  return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
}

}  // namespace cairn
