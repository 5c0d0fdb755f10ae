// SPDX-License-Identifier: Apache-2.0
#include "common/image/descriptor.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/image/descriptor_pattern.h"

namespace cairn {
namespace {

constexpr size_t kTurns = 32;  ///< orientations of the pattern, 11.25 degrees apart
constexpr int kCentroidRadius = 11;

struct Test {
  int8_t ax, ay, bx, by;
};
using Pattern = std::array<Test, kDescriptorTests.size()>;

/// The cosine of `turn` steps (0 to kTurns) of a kTurns-th of a full turn, times 2^kTurnCosineBits.
constexpr int64_t cosine(size_t turn) {
  if (turn > kTurns / 2) turn = kTurns - turn;
  return turn > kTurns / 4 ? -kTurnCosines[kTurns / 2 - turn] : kTurnCosines[turn];
}
constexpr int64_t sine(size_t turn) {
  return cosine((turn + 3 * kTurns / 4) % kTurns);
}

constexpr std::array<Pattern, kTurns> make_patterns() {
  constexpr int kBits = kDescriptorTestBits + kTurnCosineBits;
  std::array<Pattern, kTurns> patterns{};
  for (size_t turn = 0; turn < kTurns; ++turn) {
    const auto rounded = [](int64_t value) {
      return static_cast<int8_t>((value + (int64_t{1} << (kBits - 1))) >> kBits);
    };
    const int64_t c = cosine(turn);
    const int64_t s = sine(turn);
    for (size_t t = 0; t < kDescriptorTests.size(); ++t) {
      const auto& [ax, ay, bx, by] = kDescriptorTests[t];
      patterns[turn][t] = {rounded(c * ax - s * ay), rounded(s * ax + c * ay), rounded(c * bx - s * by),
                           rounded(s * bx + c * by)};
    }
  }
  return patterns;
}

constexpr std::array<Pattern, kTurns> kPatterns = make_patterns();

/// Half widths of the rows of a disc, by |y|.
constexpr std::array<int, kCentroidRadius + 1> kDisc = {11, 10, 10, 10, 10, 9, 9, 8, 7, 6, 4, 0};

/// The turn nearest to a direction; 0 for none. In integers: every machine finds the same.
size_t nearest_turn(int64_t x, int64_t y) {
  size_t quarter = 0;
  if (y > 0 && x <= 0) {
    quarter = 1;
  } else if (x < 0) {
    quarter = 2;
  } else if (y < 0) {
    quarter = 3;
  }
  const std::array<int64_t, 4> turned = {x, y, -x, -y};  // by so many quarters back
  const int64_t along = turned[quarter];
  const int64_t across = turned[(quarter + 1) % 4];
  size_t turn = quarter * (kTurns / 4);
  for (const TurnLimit& limit : kTurnLimits) turn += across * limit.x > along * limit.y ? 1 : 0;
  return turn % kTurns;
}

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
  return nearest_turn(moment_x, moment_y);
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
  const Pattern& pattern = kPatterns[orientation(smoothed, corner)];
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
