// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace cairn {

/// 64 random bits of a counter: splitmix64's output function (Steele, Lea and Flood, OOPSLA 2014).
[[nodiscard]] inline uint64_t mix_bits(uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

/// A reproducible random stream. The standard library's distributions differ between implementations; these
/// do not.
class Random {
 public:
  /// Streams of one seed are independent: one per thing generated, so that adding a thing leaves the others
  /// alone.
  explicit Random(uint64_t seed, uint64_t stream = 0) : state_(mix_bits(seed ^ mix_bits(stream))) {}

  [[nodiscard]] uint64_t bits() { return mix_bits(state_++); }
  /// [0, 1).
  [[nodiscard]] double unit() { return static_cast<double>(bits() >> 11) * 0x1.0p-53; }
  /// [low, high).
  [[nodiscard]] double uniform(double low, double high) { return low + (high - low) * unit(); }
  [[nodiscard]] float uniform(float low, float high) {
    return low + (high - low) * static_cast<float>(unit());
  }
  /// low..high, both included.
  [[nodiscard]] int integer(int low, int high) {
    return low + static_cast<int>(bits() % static_cast<uint64_t>(high - low + 1));
  }
  [[nodiscard]] bool chance(double probability) { return unit() < probability; }
  /// Standard normal (Box and Muller).
  [[nodiscard]] double normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - unit()));
    return radius * std::cos(2.0 * std::numbers::pi * unit());
  }

 private:
  uint64_t state_;
};

}  // namespace cairn
