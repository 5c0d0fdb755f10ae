// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace cairn {

/// Draws minimal samples for RANSAC: SplitMix64 (Steele et al., OOPSLA 2014), the same sequence for a seed on
/// every platform, which std::uniform_int_distribution does not promise. Not thread-safe; one per call.
class MinimalSampler {
 public:
  MinimalSampler(uint64_t seed, size_t population) : state_(seed), population_(population) {}

  /// `N` distinct indices below the population, which must be at least N.
  template <size_t N>
  [[nodiscard]] std::array<size_t, N> draw() {
    std::array<size_t, N> sample{};
    for (size_t i = 0; i < N; ++i) {
      bool repeated = true;
      while (repeated) {
        sample[i] = static_cast<size_t>(next() % population_);
        repeated = false;
        for (size_t j = 0; j < i; ++j) repeated = repeated || sample[j] == sample[i];
      }
    }
    return sample;
  }

 private:
  uint64_t next() {
    uint64_t z = (state_ += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }

  uint64_t state_;
  size_t population_;
};

/// RANSAC trials after which a sample of `sample_size` inliers has been drawn with probability 0.999
/// (Fischler and Bolles 1981), at most `limit`.
[[nodiscard]] inline int required_trials(double inlier_fraction, int sample_size, int limit) {
  const double all_inliers = std::pow(inlier_fraction, sample_size);
  if (all_inliers < 1e-9) return limit;
  if (all_inliers > 1 - 1e-9) return 1;
  const double trials = std::log(1e-3) / std::log1p(-all_inliers);
  return trials < limit ? static_cast<int>(trials) + 1 : limit;
}

}  // namespace cairn
