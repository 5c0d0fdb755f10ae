// SPDX-License-Identifier: Apache-2.0
#include "common/image/descriptor.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace cairn {
namespace {

constexpr int kTurns = 32;  ///< orientations of the pattern, 11.25 degrees apart
constexpr size_t kTests = 256;
constexpr int kCentroidRadius = 11;
constexpr double kSpread = 5.2;  ///< [px] sigma of the test positions (BRIEF's G II: a fifth of the patch)
constexpr int kReach = kDescriptorRadius - 1;  ///< farthest test position; a turn adds rounding only

struct Test {
  int8_t ax, ay, bx, by;
};
using Pattern = std::array<Test, kTests>;

uint64_t next_random(uint64_t* state) {  // SplitMix64 (Steele et al., OOPSLA 2014)
  uint64_t z = (*state += 0x9E3779B97F4A7C15ULL);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

/// A position from the normal distribution, inside the disc.
std::array<double, 2> draw_position(uint64_t* state) {
  for (;;) {
    const double u = (static_cast<double>(next_random(state) >> 11) + 1) * 0x1.0p-53;
    const double v = static_cast<double>(next_random(state) >> 11) * 0x1.0p-53;
    const double radius = kSpread * std::sqrt(-2 * std::log(u));
    if (radius > kReach - 0.5) continue;
    return {radius * std::cos(2 * std::numbers::pi * v), radius * std::sin(2 * std::numbers::pi * v)};
  }
}

std::array<Pattern, kTurns> make_patterns() {
  std::array<Pattern, kTurns> patterns{};
  uint64_t state = 20081;
  for (size_t t = 0; t < kTests; ++t) {
    const auto a = draw_position(&state);
    auto b = draw_position(&state);
    while (std::hypot(a[0] - b[0], a[1] - b[1]) < 2) b = draw_position(&state);
    for (size_t turn = 0; turn < kTurns; ++turn) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(turn) / kTurns;
      const double c = std::cos(angle);
      const double s = std::sin(angle);
      const auto rounded = [](double value) { return static_cast<int8_t>(std::lround(value)); };
      patterns[turn][t] = {rounded(c * a[0] - s * a[1]), rounded(s * a[0] + c * a[1]),
                           rounded(c * b[0] - s * b[1]), rounded(s * b[0] + c * b[1])};
    }
  }
  return patterns;
}

const std::array<Pattern, kTurns>& patterns() {
  static const std::array<Pattern, kTurns> made = make_patterns();
  return made;
}

/// Half widths of the rows of a disc, by |y|.
constexpr std::array<int, kCentroidRadius + 1> kDisc = {11, 10, 10, 10, 10, 9, 9, 8, 7, 6, 4, 0};

/// Which of the turned patterns fits: direction from the corner to the centre of brightness around it.
size_t orientation(const GrayView& image, Corner corner) {
  int moment_x = 0;
  int moment_y = 0;
  for (int dy = -kCentroidRadius; dy <= kCentroidRadius; ++dy) {
    const uint8_t* row = image.row(corner.y + dy) + corner.x;
    const int half = kDisc[static_cast<size_t>(std::abs(dy))];
    int sum = 0;
    for (int dx = -half; dx <= half; ++dx) {
      sum += row[dx];
      moment_x += dx * row[dx];
    }
    moment_y += dy * sum;
  }
  const double angle = std::atan2(static_cast<double>(moment_y), static_cast<double>(moment_x));
  const auto turn = static_cast<int>(std::lround(angle * kTurns / (2 * std::numbers::pi)));
  return static_cast<size_t>((turn + kTurns) % kTurns);
}

void smooth_row(const uint8_t* in, int width, uint16_t* padded, uint16_t* out) {
  for (int i = 0; i < 2; ++i) {
    padded[i] = in[0];
    padded[width + 2 + i] = in[width - 1];
  }
  for (int x = 0; x < width; ++x) padded[x + 2] = in[x];
  for (int x = 0; x < width; ++x) {
    out[x] = static_cast<uint16_t>(padded[x] + padded[x + 4] + 4 * (padded[x + 1] + padded[x + 3]) +
                                   6 * padded[x + 2]);
  }
}

void smooth_once(const GrayView& image, GrayImage* out) {
  const int width = image.width;
  out->resize(width, image.height);
  std::vector<uint16_t> padded(static_cast<size_t>(width) + 4);
  std::array<std::vector<uint16_t>, 5> rows;  // by y modulo 5
  for (auto& row : rows) row.resize(static_cast<size_t>(width));
  const auto row_of = [&](int y) { return rows[static_cast<size_t>(y % 5)].data(); };
  int done = 0;
  for (int y = 0; y < image.height; ++y) {
    for (; done <= std::min(y + 2, image.height - 1); ++done) {
      smooth_row(image.row(done), width, padded.data(), row_of(done));
    }
    const auto clamped = [&](int r) { return row_of(std::clamp(r, 0, image.height - 1)); };
    const uint16_t* const r[5] = {clamped(y - 2), clamped(y - 1), clamped(y), clamped(y + 1), clamped(y + 2)};
    uint8_t* to = out->row(y);
    for (int x = 0; x < width; ++x) {
      const int sum = r[0][x] + r[4][x] + 4 * (r[1][x] + r[3][x]) + 6 * r[2][x];
      to[x] = static_cast<uint8_t>((sum + 128) >> 8);
    }
  }
}

}  // namespace

void smooth_for_descriptors(const GrayView& image, GrayImage* out) {
  if (image.empty()) {
    out->resize(image.width, image.height);
    return;
  }
  GrayImage once;
  smooth_once(image, &once);
  smooth_once(once, out);
}

bool describe(const GrayView& smoothed, Corner corner, Descriptor* out) {
  const bool inside = corner.x >= kDescriptorRadius && corner.y >= kDescriptorRadius &&
                      corner.x < smoothed.width - kDescriptorRadius &&
                      corner.y < smoothed.height - kDescriptorRadius;
  if (!inside) return false;
  const Pattern& pattern = patterns()[orientation(smoothed, corner)];
  const uint8_t* center = smoothed.row(corner.y) + corner.x;
  const ptrdiff_t stride = smoothed.stride;
  for (size_t word = 0; word < out->size(); ++word) {
    uint64_t bits = 0;
    for (size_t i = 0; i < 64; ++i) {
      const Test& t = pattern[64 * word + i];
      const bool darker = center[t.ay * stride + t.ax] < center[t.by * stride + t.bx];
      bits |= static_cast<uint64_t>(darker) << i;
    }
    (*out)[word] = bits;
  }
  return true;
}

}  // namespace cairn
