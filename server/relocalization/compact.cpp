// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/compact.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "common/base/simd.h"

namespace cairn {
namespace {

/// Frequencies, in half periods: below kAcross along rows, kDown along columns.
constexpr size_t kAcross = 12;
constexpr size_t kDown = 9;

struct Frequency {
  uint8_t across = 0;
  uint8_t down = 0;
  /// Squared, in periods per pixel of a 4:3 image.
  [[nodiscard]] constexpr int squared() const { return 9 * across * across + 16 * down * down; }
};

constexpr std::array<Frequency, kCompactSize> lowest_frequencies() {
  std::array<Frequency, kAcross * kDown> all{};
  for (size_t i = 0; i < all.size(); ++i)
    all[i] = {static_cast<uint8_t>(i % kAcross), static_cast<uint8_t>(i / kAcross)};
  std::sort(all.begin(), all.end(), [](Frequency a, Frequency b) {
    return a.squared() != b.squared() ? a.squared() < b.squared() : a.across < b.across;
  });
  std::array<Frequency, kCompactSize> lowest{};
  std::copy_n(all.begin() + 1, kCompactSize, lowest.begin());
  return lowest;
}
constexpr std::array<Frequency, kCompactSize> kFrequencies = lowest_frequencies();
static_assert(kFrequencies.back().squared() < Frequency{kAcross, 0}.squared() &&
                  kFrequencies.back().squared() < Frequency{0, kDown}.squared(),
              "what lies outside the table is higher");

/// Row i: the values of `count` cosines of the orthonormal transform of `size` values at i. Those that it
/// does not have are 0.
std::vector<float> make_cosines(size_t count, size_t size) {
  std::vector<float> table(count * size);
  for (size_t k = 0; k < std::min(count, size); ++k) {
    const double scale = std::sqrt((k == 0 ? 1.0 : 2.0) / static_cast<double>(size));
    const double step = std::numbers::pi * static_cast<double>(k) / static_cast<double>(size);
    for (size_t i = 0; i < size; ++i)
      table[i * count + k] = static_cast<float>(scale * std::cos(step * (static_cast<double>(i) + 0.5)));
  }
  return table;
}

}  // namespace

float contrast_of(const TinyImage& tiny) {
  double sum = 0;
  for (const float v : tiny.values()) sum += static_cast<double>(v) * static_cast<double>(v);
  return tiny.empty() ? 0 : static_cast<float>(std::sqrt(sum / static_cast<double>(tiny.values().size())));
}

CompactImage make_compact(const TinyImage& tiny) {
  CompactImage compact;
  compact.width = static_cast<uint16_t>(tiny.width());
  compact.height = static_cast<uint16_t>(tiny.height());
  const float contrast = contrast_of(tiny);
  if (!(contrast > 0)) return compact;
  const std::vector<float> across = make_cosines(kAcross, compact.width);
  const std::vector<float> down = make_cosines(kDown, compact.height);
  std::array<float, kAcross * kDown> transformed{};
  for (size_t y = 0; y < compact.height; ++y) {
    const float* row = tiny.values().data() + y * compact.width;
    std::array<float, kAcross> along{};
    for (size_t x = 0; x < compact.width; ++x) {
      for (size_t k = 0; k < kAcross; ++k) along[k] += row[x] * across[x * kAcross + k];
    }
    for (size_t l = 0; l < kDown; ++l) {
      for (size_t k = 0; k < kAcross; ++k) transformed[l * kAcross + k] += along[k] * down[y * kDown + l];
    }
  }
  const float scale = 1 / (contrast * std::sqrt(static_cast<float>(tiny.values().size())));
  for (size_t i = 0; i < kCompactSize; ++i)
    compact.values[i] = scale * transformed[kFrequencies[i].down * kAcross + kFrequencies[i].across];
  return compact;
}

float compact_distance(const float* a, const float* b, float limit) {
  constexpr size_t kLanes = 4;   // every processor has these: the same sums on every machine
  constexpr size_t kChunk = 16;  // values between two looks at the limit
  static_assert(kCompactSize % kChunk == 0);
  float sum = 0;
  for (size_t begin = 0; begin < kCompactSize && sum <= limit; begin += kChunk) {
    F32x4 sums{};
    for (size_t i = begin; i < begin + kChunk; i += kLanes) {
      const F32x4 d = load_lanes<F32x4>(a + i) - load_lanes<F32x4>(b + i);
      sums += d * d;
    }
    sum += (sums[0] + sums[1]) + (sums[2] + sums[3]);
  }
  return sum;
}

float compact_distance(const CompactImage& a, const CompactImage& b, float limit) {
  if (!is_comparable(a, b)) return std::numeric_limits<float>::infinity();
  return compact_distance(a.values.data(), b.values.data(), limit);
}

}  // namespace cairn
