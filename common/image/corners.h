// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "common/image/image.h"
#include "common/image/pyramid.h"

namespace cairn {

struct Corner {
  int16_t x = 0;
  int16_t y = 0;
  bool operator==(const Corner&) const = default;
};

/// Corners of one image in row-major order with a row look-up table.
struct CornerList {
  std::vector<Corner> corners;
  std::vector<uint32_t>
      row_begin;  ///< height + 1 entries: corners of row y are [row_begin[y], row_begin[y + 1])
  void clear() {
    corners.clear();
    row_begin.clear();
  }
};

/// FAST-10 (Rosten and Drummond, ECCV 2006): 10 contiguous of the 16 pixels on a circle of radius 3 all
/// brighter than centre + threshold or all darker than centre - threshold. No non-maximum suppression.
/// Vectorized with run-time dispatch (scalar, SSE2, AVX2 give the same list). Corners at least 3 px inside
/// the image. Reuses the memory of `out`.
void detect_fast10(const GrayView& image, int threshold, CornerList* out);

/// FAST's thresholds by level of the pyramid [grey levels] (PTAM r114). No option: the tracker, the map maker
/// and the relocalizer must find the same corners in an image.
inline constexpr std::array<int, kPyramidLevels> kFastThresholds{10, 15, 15, 10};

/// The corners of all levels, by those thresholds.
[[nodiscard]] std::array<CornerList, kPyramidLevels> detect_corners(const Pyramid& pyramid);

/// FAST score: the largest threshold at which the pixel is still a FAST-10 corner (0..254); 0 also where
/// it is none at any.
[[nodiscard]] int fast10_score(const GrayView& image, int x, int y);

/// Shi-Tomasi minimum eigenvalue of the gradient matrix in a (2 half_size + 1)^2 box; gradients are unhalved
/// central differences, sums divided by 2 n (PTAM r114: candidates have > 70 at half size 3). Needs half_size
/// + 1 px of border.
[[nodiscard]] float shi_tomasi(const GrayView& image, int x, int y, int half_size = 3);

struct Candidate {
  Corner corner;
  float score = 0;  ///< Shi-Tomasi
};

/// Keyframe candidates: FAST corners with score >= barrier, non-maximum suppressed in 3x3 of the FAST score,
/// at least `border` px inside, Shi-Tomasi above `min_shi_tomasi`. Row-major order. PTAM r114.
[[nodiscard]] std::vector<Candidate> find_candidates(const GrayView& image, const CornerList& corners,
                                                     int barrier = 10, int border = 14,
                                                     float min_shi_tomasi = 70.0F);

}  // namespace cairn
