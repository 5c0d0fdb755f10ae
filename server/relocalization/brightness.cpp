// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/brightness.h"

#include <algorithm>
#include <cmath>

#include "common/image/patch.h"
#include "common/image/pyramid.h"

namespace cairn {
namespace {

constexpr int kWindow = 2;    ///< [px of level 3] on each side: 40 px of the image
constexpr int kWhite = 254;   ///< [grey levels] of a pixel made of 64 that were clipped
constexpr int kBlack = 1;     ///< likewise
constexpr double kNoise = 3;  ///< [grey levels] added to the contrast

}  // namespace

float white_share(const GrayView& small) {
  ptrdiff_t white = 0;
  for (int y = 0; y < small.height; ++y)
    white +=
        std::count_if(small.row(y), small.row(y) + small.width, [](uint8_t grey) { return grey >= kWhite; });
  return static_cast<float>(white) / static_cast<float>(std::max(1, small.width * small.height));
}

std::optional<Brightness> brightness_at(const GrayView& small, const Eigen::Vector2f& level0) {
  constexpr int kLevel = kPyramidLevels - 1;
  const float x = to_level(level0.x(), kLevel);
  const float y = to_level(level0.y(), kLevel);
  if (!small.contains(x, y) || x >= static_cast<float>(small.width - 1) ||
      y >= static_cast<float>(small.height - 1))
    return std::nullopt;
  const auto column = static_cast<int>(std::lround(x));
  const auto row = static_cast<int>(std::lround(y));
  const int left = std::max(0, column - kWindow);
  const int right = std::min(small.width - 1, column + kWindow);
  const int top = std::max(0, row - kWindow);
  const int bottom = std::min(small.height - 1, row + kWindow);
  int sum = 0;
  int squares = 0;
  int darkest = kWhite;
  int brightest = kBlack;
  for (int v = top; v <= bottom; ++v) {
    for (int u = left; u <= right; ++u) {
      const int grey = small.row(v)[u];
      sum += grey;
      squares += grey * grey;
      darkest = std::min(darkest, grey);
      brightest = std::max(brightest, grey);
    }
  }
  if (darkest == kWhite || brightest == kBlack) return std::nullopt;
  const double n = (right - left + 1) * (bottom - top + 1);
  const double mean = sum / n;
  const double deviation = std::sqrt(std::max(0.0, squares / n - mean * mean));
  const auto grey = static_cast<double>(sample_bilinear(small, x, y));
  return Brightness{static_cast<float>((grey - mean) / (deviation + kNoise)),
                    static_cast<uint8_t>(std::lround(grey))};
}

}  // namespace cairn
