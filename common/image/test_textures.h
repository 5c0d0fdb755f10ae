// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <random>
#include <type_traits>
#include <vector>

#include "common/base/simd.h"
#include "common/image/image.h"

/// Images for the tests of common/image.
namespace cairn::test {

/// The variants that this machine has, the reference first.
inline std::vector<Simd> simd_variants() {
  std::vector<Simd> variants = {Simd::kScalar, Simd::kNarrow};
  if (has_wide()) variants.push_back(Simd::kWide);
  return variants;
}

/// FNV-1a of bytes: what golden tests compare. Both processors that there are keep the low byte first.
struct Hash {
  uint64_t value = 0xCBF29CE484222325ULL;

  template <class T>
  void add(const T& what) {
    static_assert(std::has_unique_object_representations_v<T> || std::is_floating_point_v<T>, "no padding");
    std::array<uint8_t, sizeof(T)> bytes;
    std::memcpy(bytes.data(), &what, sizeof(T));
    for (const uint8_t byte : bytes) value = (value ^ byte) * 0x100000001B3ULL;
  }
};

/// Texture in every direction with some noise, made of integers: the same on every machine.
inline GrayImage integer_image(int width, int height) {
  GrayImage image(width, height);
  uint32_t state = 1;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      state = state * 1664525U + 1013904223U;
      const int u = (x * 7 + y * 3) % 61;
      const int v = (y * 5 - x * 2 + 2 * width) % 83;
      image.row(y)[x] = static_cast<uint8_t>((state >> 26) + static_cast<uint32_t>(u * v % 191));
    }
  }
  return image;
}

/// A random smooth function of the plane or of space: a sum of plane waves, mean 128, known everywhere.
template <int dimensions>
class Waves {
 public:
  using Point = Eigen::Matrix<double, dimensions, 1>;

  /// Wave numbers up to `max_frequency` [rad per unit].
  Waves(uint32_t seed, double max_frequency, int count = 12) {
    std::mt19937 rng(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> unit(0, 1);
    for (int i = 0; i < count; ++i) {
      Point direction;
      for (int d = 0; d < dimensions; ++d) direction(d) = normal(rng);
      waves_.push_back({direction.normalized() * max_frequency * (0.2 + 0.8 * unit(rng)), 6.3 * unit(rng)});
    }
    amplitude_ = 100.0 / std::sqrt(static_cast<double>(count));
  }

  double operator()(const Point& p) const {
    double sum = 128;
    for (const Wave& w : waves_) sum += amplitude_ * std::cos(w.number.dot(p) + w.phase);
    return std::clamp(sum, 0.0, 255.0);
  }

 private:
  struct Wave {
    Point number;
    double phase;
  };
  std::vector<Wave> waves_;
  double amplitude_ = 0;
};

/// The image whose pixel (x, y) is f(x, y), rounded.
template <class Function>
GrayImage render(int width, int height, const Function& f) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.row(y)[x] = static_cast<uint8_t>(std::lround(f(x, y)));
  }
  return image;
}

/// Pixels with no byte to spare around them: AddressSanitizer sees every read outside.
class TightImage {
 public:
  TightImage(int width, int height)
      : pixels_(static_cast<size_t>(width * height)), width_(width), height_(height) {}

  /// Noise that is smooth enough to have arcs: neighbours differ by at most `step`.
  static TightImage noise(int width, int height, int step, std::mt19937* rng) {
    TightImage image(width, height);
    std::uniform_int_distribution<int> delta(-step, step);
    int value = 128;
    for (uint8_t& p : image.pixels_) {
      value = std::clamp(value + delta(*rng), 0, 255);
      p = static_cast<uint8_t>(value);
    }
    return image;
  }

  [[nodiscard]] GrayView view() const { return {pixels_.data(), width_, height_, width_}; }
  [[nodiscard]] std::vector<uint8_t>& pixels() { return pixels_; }

 private:
  std::vector<uint8_t> pixels_;
  int width_;
  int height_;
};

/// Rectangles of random grey over one another, as things lie on a desk (dead leaves), at whole pixels,
/// repeating after `kSize` px: corners well apart, and quick to show.
class Leaves {
 public:
  static constexpr int kSize = 512;  ///< [px]

  explicit Leaves(uint32_t seed) : values_(static_cast<size_t>(kSize) * kSize, 128) {
    std::mt19937 rng(seed);
    std::uniform_int_distribution<int> place(0, kSize - 1);
    std::uniform_int_distribution<int> size(14, 60);
    std::uniform_int_distribution<int> grey(20, 235);
    constexpr int kLeaves = 1500;
    for (int i = 0; i < kLeaves; ++i) {
      const int left = place(rng);
      const int top = place(rng);
      const int width = size(rng);
      const int height = size(rng);
      const auto value = static_cast<float>(grey(rng));
      for (int y = top; y < top + height; ++y) {
        for (int x = left; x < left + width; ++x) values_[index(x, y)] = value;
      }
    }
  }
  /// Grey level, 0 to 255.
  [[nodiscard]] float at(int x, int y) const { return values_[index(x, y)]; }

 private:
  static size_t index(int x, int y) {
    return static_cast<size_t>((y & (kSize - 1)) * kSize + (x & (kSize - 1)));
  }
  std::vector<float> values_;
};

}  // namespace cairn::test
