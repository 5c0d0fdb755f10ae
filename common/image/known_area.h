// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>

namespace cairn {

/// How much of an image is new to a map: of its cells that have texture, those in which no point of the map
/// was measured. Map maker and tracker judge a keyframe by the same measure.
class KnownArea {
 public:
  /// A view of which so much is unknown shows a new area.
  static constexpr double kNewAreaFraction = 0.5;

  KnownArea(int width, int height) : width_(width), height_(height) {}

  void add_corner(float x, float y) { ++corners_[cell(x, y)]; }
  void add_measurement(float x, float y) { known_[cell(x, y)] = true; }
  [[nodiscard]] double unknown_fraction() const {
    int textured = 0;
    int unknown = 0;
    for (size_t i = 0; i < corners_.size(); ++i) {
      if (corners_[i] < kTexturedCorners) continue;
      ++textured;
      if (!known_[i]) ++unknown;
    }
    return textured == 0 ? 0.0 : static_cast<double>(unknown) / textured;
  }

 private:
  static constexpr int kColumns = 8;
  static constexpr int kRows = 6;
  static constexpr int kTexturedCorners = 3;  ///< that make a cell textured

  [[nodiscard]] size_t cell(float x, float y) const {
    const int column = std::clamp(static_cast<int>(x) * kColumns / width_, 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(y) * kRows / height_, 0, kRows - 1);
    return static_cast<size_t>(row * kColumns + column);
  }

  int width_;
  int height_;
  std::array<int, size_t{kColumns} * kRows> corners_{};
  std::array<bool, size_t{kColumns} * kRows> known_{};
};

}  // namespace cairn
