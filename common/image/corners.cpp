// SPDX-License-Identifier: Apache-2.0
#include "common/image/corners.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>

#include "common/image/kernels.h"

namespace cairn {
namespace {

constexpr int kRing = 16;       ///< pixels on the circle
constexpr int kArc = 10;        ///< contiguous ones that make a corner
constexpr int kRingRadius = 3;  ///< px

/// The circle's pixels relative to its centre, clockwise from the top.
constexpr std::array<int, kRing> kRingX = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
constexpr std::array<int, kRing> kRingY = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};

CAIRN_INLINE const uint8_t* ring_pixel(const uint8_t* center, ptrdiff_t stride, size_t k) {
  return center + kRingY[k] * stride + kRingX[k];
}

/// The minimum if `bright`, else the maximum: a dark arc is a bright arc of the negative.
template <bool bright, class V>
CAIRN_INLINE void lower(const V& a, const V& b, V* out) {
  if constexpr (bright) {
    *out = a < b ? a : b;
  } else {
    *out = a > b ? a : b;
  }
}

/// Maximum over all arcs of 10 of the minimum over the arc (bright), or minimum of the maximum (dark): the
/// centre plus a threshold must lie below it (above, with minus) to be a corner. V is a number or a vector of
/// them.
///
/// The arcs that begin at 2k and 2k + 1 share nine pixels, and the nines are built by doubling: 55 operations
/// for 16 arcs.
template <bool bright, class V>
CAIRN_INLINE void best_arc(const std::array<V, kRing>& ring, V* best) {
  std::array<V, 8> twos;   // pixels 2k+1, 2k+2
  std::array<V, 8> fours;  // pixels 2k+1 .. 2k+4
#pragma GCC unroll 8
  for (size_t k = 0; k < 8; ++k) lower<bright>(ring[2 * k + 1], ring[(2 * k + 2) % kRing], &twos[k]);
#pragma GCC unroll 8
  for (size_t k = 0; k < 8; ++k) lower<bright>(twos[k], twos[(k + 1) % 8], &fours[k]);
#pragma GCC unroll 8
  for (size_t k = 0; k < 8; ++k) {
    V nine;
    V end;
    V arc;
    lower<bright>(fours[k], fours[(k + 2) % 8], &nine);
    lower<bright>(nine, ring[(2 * k + 9) % kRing], &nine);
    lower<!bright>(ring[2 * k], ring[(2 * k + 10) % kRing], &end);
    lower<bright>(nine, end, &arc);
    if (k == 0) {
      *best = arc;
    } else {
      lower<!bright>(*best, arc, best);
    }
  }
}

/// Loads the diameters that end at ring pixels `first` and `first` + 4, and clears the bits of lanes where
/// these four rule a corner out: an arc of 10 holds an end of every diameter.
template <class V>
CAIRN_INLINE void reject_by_diameters(const uint8_t* center, ptrdiff_t stride, size_t first, const V& above,
                                      const V& below, std::array<V, kRing>* ring, uint32_t* bright,
                                      uint32_t* dark) {
#pragma GCC unroll 4
  for (size_t k = first; k < kRing; k += 4) load_lanes(ring_pixel(center, stride, k), &(*ring)[k]);
  V end_a;
  V end_b;
  V limit;
  lower<false>((*ring)[first], (*ring)[first + 8], &end_a);
  lower<false>((*ring)[first + 4], (*ring)[first + 12], &end_b);
  lower<true>(end_a, end_b, &limit);
  *bright &= ~byte_lane_bits(V(limit <= above));
  lower<true>((*ring)[first], (*ring)[first + 8], &end_a);
  lower<true>((*ring)[first + 4], (*ring)[first + 12], &end_b);
  lower<false>(end_a, end_b, &limit);
  *dark &= ~byte_lane_bits(V(limit >= below));
}

/// Bit i is set where pixel center[i] is a FAST-10 corner. Reads 3 px to each side of the lanes.
template <class V>
CAIRN_INLINE uint32_t corner_bits(const uint8_t* center, ptrdiff_t stride, const V& threshold,
                                  const V& threshold_complement) {
  V c;
  load_lanes(center, &c);
  // Saturating sums: lanes where centre + threshold leaves the byte compare with 255 or 0, which nothing
  // exceeds.
  const V above = (c < threshold_complement ? c : threshold_complement) + threshold;
  const V below = (c > threshold ? c : threshold) - threshold;

  std::array<V, kRing> ring;
  constexpr auto kAllLanes = static_cast<uint32_t>((uint64_t{1} << sizeof(V)) - 1);
  uint32_t bright = kAllLanes;
  uint32_t dark = kAllLanes;
  reject_by_diameters(center, stride, 0, above, below, &ring, &bright, &dark);
  if ((bright | dark) == 0) return 0;
  reject_by_diameters(center, stride, 2, above, below, &ring, &bright, &dark);
  if ((bright | dark) == 0) return 0;

#pragma GCC unroll 8
  for (size_t k = 1; k < kRing; k += 2) load_lanes(ring_pixel(center, stride, k), &ring[k]);
  V best;
  if (bright != 0) {
    best_arc<true>(ring, &best);
    bright &= ~byte_lane_bits(V(best <= above));
  }
  if (dark != 0) {
    best_arc<false>(ring, &best);
    dark &= ~byte_lane_bits(V(best >= below));
  }
  return bright | dark;
}

/// Appends the corners of one row; the row must have at least one vector's worth of pixels between its
/// borders.
template <class V>
CAIRN_INLINE void append_row(const uint8_t* row, int width, int y, ptrdiff_t stride, int threshold,
                             std::vector<Corner>* corners) {
  constexpr int kLanes = sizeof(V);
  V t;
  V t_complement;
  std::memset(&t, threshold, sizeof t);
  std::memset(&t_complement, 255 - threshold, sizeof t_complement);
  const int end = width - kRingRadius;
  for (int x = kRingRadius; x < end; x += kLanes) {
    // The last vector overlaps the one before, so that nothing beyond the row is read; its known lanes are
    // dropped.
    const int begin = std::min(x, end - kLanes);
    uint32_t bits = corner_bits(row + begin, stride, t, t_complement);
    for (bits &= ~0U << (x - begin); bits != 0; bits &= bits - 1) {
      corners->push_back({static_cast<int16_t>(begin + std::countr_zero(bits)), static_cast<int16_t>(y)});
    }
  }
}

void append_row_narrow(const uint8_t* row, int width, int y, ptrdiff_t stride, int threshold,
                       std::vector<Corner>* corners) {
  append_row<U8x16>(row, width, y, stride, threshold, corners);
}

CAIRN_WIDE void append_row_wide(const uint8_t* row, int width, int y, ptrdiff_t stride, int threshold,
                                std::vector<Corner>* corners) {
  append_row<U8x32>(row, width, y, stride, threshold, corners);
}

/// Whether `mask` (one bit per ring pixel) has kArc neighbouring bits, around the end too.
bool has_arc(uint32_t mask) {
  mask |= mask << kRing;
  mask &= mask >> 1;  // runs of 2
  mask &= mask >> 2;  // of 4
  mask &= mask >> 4;  // of 8
  mask &= mask >> (kArc - 8);
  return mask != 0;
}

/// The definition, one pixel at a time.
void append_row_scalar(const uint8_t* row, int width, int y, ptrdiff_t stride, int threshold,
                       std::vector<Corner>* corners) {
  for (int x = kRingRadius; x < width - kRingRadius; ++x) {
    uint32_t bright = 0;
    uint32_t dark = 0;
    for (size_t k = 0; k < kRing; ++k) {
      const int difference = *ring_pixel(row + x, stride, k) - row[x];
      bright |= static_cast<uint32_t>(difference > threshold) << k;
      dark |= static_cast<uint32_t>(difference < -threshold) << k;
    }
    if (has_arc(bright) || has_arc(dark))
      corners->push_back({static_cast<int16_t>(x), static_cast<int16_t>(y)});
  }
}

/// The FAST score that follows from what best_arc() returned for brighter and for darker pixels.
int score_of(int brightest, int darkest, int center) {
  return std::max({brightest - center, center - darkest, 1}) - 1;
}

/// fast10_score() of each corner, sixteen at a time.
std::vector<int> fast10_scores(const GrayView& image, const std::vector<Corner>& corners) {
  constexpr size_t kLanes = sizeof(U8x16);
  std::vector<int> scores(corners.size());
  std::array<std::array<uint8_t, kLanes>, kRing> gathered{};
  for (size_t first = 0; first < corners.size(); first += kLanes) {
    const size_t count = std::min(kLanes, corners.size() - first);
    for (size_t lane = 0; lane < count; ++lane) {
      const Corner c = corners[first + lane];
      const uint8_t* center = image.row(c.y) + c.x;
      for (size_t k = 0; k < kRing; ++k) gathered[k][lane] = *ring_pixel(center, image.stride, k);
    }
    std::array<U8x16, kRing> ring;
    for (size_t k = 0; k < kRing; ++k) load_lanes(gathered[k].data(), &ring[k]);
    U8x16 brightest;
    U8x16 darkest;
    best_arc<true>(ring, &brightest);
    best_arc<false>(ring, &darkest);
    for (size_t lane = 0; lane < count; ++lane) {
      const Corner c = corners[first + lane];
      scores[first + lane] = score_of(brightest[lane], darkest[lane], image.row(c.y)[c.x]);
    }
  }
  return scores;
}

/// Strictly above each of its 8 neighbours, or equal to one that comes later in row-major order: a plateau
/// keeps one. `scores` are those of corners.corners.
class NonMaximumSuppression {
 public:
  NonMaximumSuppression(const CornerList& corners, const std::vector<int>& scores)
      : corners_(corners), scores_(scores) {}

  [[nodiscard]] bool is_maximum(size_t index) const {
    const Corner c = corners_.corners[index];
    for (int y = c.y - 1; y <= c.y + 1; ++y) {
      for (size_t i = first_from(c.x - 1, y); i < row_end(y) && corners_.corners[i].x <= c.x + 1; ++i) {
        if (scores_[i] > scores_[index] || (scores_[i] == scores_[index] && i < index)) return false;
      }
    }
    return true;
  }

 private:
  [[nodiscard]] size_t row_end(int y) const { return corners_.row_begin[static_cast<size_t>(y) + 1]; }
  /// First corner of row y with an x of at least `x`.
  [[nodiscard]] size_t first_from(int x, int y) const {
    const auto begin = corners_.corners.begin() + corners_.row_begin[static_cast<size_t>(y)];
    const auto end = corners_.corners.begin() + static_cast<ptrdiff_t>(row_end(y));
    const auto found =
        std::lower_bound(begin, end, x, [](const Corner& c, int limit) { return c.x < limit; });
    return static_cast<size_t>(found - corners_.corners.begin());
  }

  const CornerList& corners_;
  const std::vector<int>& scores_;
};

/// Sums of the products of a window's gradients, which are unhalved central differences.
struct GradientSums {
  int xx = 0;
  int xy = 0;
  int yy = 0;
};

GradientSums gradient_sums_scalar(const GrayView& image, int x, int y, int half_size) {
  GradientSums sums;
  for (int v = y - half_size; v <= y + half_size; ++v) {
    const uint8_t* above = image.row(v - 1);
    const uint8_t* here = image.row(v);
    const uint8_t* below = image.row(v + 1);
    for (int u = x - half_size; u <= x + half_size; ++u) {
      const int gx = here[u + 1] - here[u - 1];
      const int gy = below[u] - above[u];
      sums.xx += gx * gx;
      sums.xy += gx * gy;
      sums.yy += gy * gy;
    }
  }
  return sums;
}

constexpr int kSevenWide = 3;  ///< half size of the box that candidates are judged by

/// The box is a lane narrower than a register: the lane to its left is read, for which there is always a
/// pixel, and not counted.
GradientSums gradient_sums_seven(const GrayView& image, int x, int y) {
  const I16x8 counted = {0, -1, -1, -1, -1, -1, -1, -1};
  const auto eight = [&](int u, int v) { return bytes_to_i16x8(image.row(v) + u); };
  const int first = x - kSevenWide - 1;
  I32x4 xx{};
  I32x4 xy{};
  I32x4 yy{};
  I16x8 above = eight(first, y - kSevenWide - 1);
  I16x8 here = eight(first, y - kSevenWide);
  for (int v = y - kSevenWide; v <= y + kSevenWide; ++v) {
    const I16x8 below = eight(first, v + 1);
    const I16x8 gx = (eight(first + 1, v) - eight(first - 1, v)) & counted;
    const I16x8 gy = (below - above) & counted;
    xx += multiply_add_pairs(gx, gx);
    xy += multiply_add_pairs(gx, gy);
    yy += multiply_add_pairs(gy, gy);
    above = here;
    here = below;
  }
  return {.xx = sum_of_lanes(xx), .xy = sum_of_lanes(xy), .yy = sum_of_lanes(yy)};
}

}  // namespace

void kernels::detect_fast10(const GrayView& image, int threshold, CornerList* out, Simd simd) {
  out->corners.clear();
  out->row_begin.assign(static_cast<size_t>(image.height) + 1, 0);
  const int inner_width = image.width - 2 * kRingRadius;
  if (inner_width <= 0) return;
  auto append = append_row_scalar;
  if (simd == Simd::kWide && inner_width >= static_cast<int>(sizeof(U8x32))) {
    append = append_row_wide;
  } else if (simd != Simd::kScalar && inner_width >= static_cast<int>(sizeof(U8x16))) {
    append = append_row_narrow;
  }
  const int clamped = std::clamp(threshold, 0, 255);
  for (int y = 0; y < image.height; ++y) {
    if (y >= kRingRadius && y < image.height - kRingRadius) {
      append(image.row(y), image.width, y, image.stride, clamped, &out->corners);
    }
    out->row_begin[static_cast<size_t>(y) + 1] = static_cast<uint32_t>(out->corners.size());
  }
}

void detect_fast10(const GrayView& image, int threshold, CornerList* out) {
  kernels::detect_fast10(image, threshold, out, best_simd());
}

std::array<CornerList, kPyramidLevels> detect_corners(const Pyramid& pyramid) {
  std::array<CornerList, kPyramidLevels> corners;
  for (int level = 0; level < kPyramidLevels; ++level) {
    const auto l = static_cast<size_t>(level);
    detect_fast10(pyramid.level(level), kFastThresholds[l], &corners[l]);
  }
  return corners;
}

int fast10_score(const GrayView& image, int x, int y) {
  const uint8_t* center = image.row(y) + x;
  std::array<int, kRing> ring{};
  for (size_t k = 0; k < kRing; ++k) ring[k] = *ring_pixel(center, image.stride, k);
  int brightest = 0;
  int darkest = 0;
  best_arc<true>(ring, &brightest);
  best_arc<false>(ring, &darkest);
  return score_of(brightest, darkest, *center);
}

float shi_tomasi(const GrayView& image, int x, int y, int half_size) {
  const GradientSums sums = half_size == kSevenWide ? gradient_sums_seven(image, x, y)
                                                    : gradient_sums_scalar(image, x, y, half_size);
  const int side = 2 * half_size + 1;
  const double norm = 1.0 / (2.0 * side * side);
  const double trace = norm * (static_cast<double>(sums.xx) + sums.yy);
  const double difference = norm * (static_cast<double>(sums.xx) - sums.yy);
  return static_cast<float>(0.5 * (trace - std::hypot(difference, 2.0 * norm * sums.xy)));
}

std::vector<Candidate> find_candidates(const GrayView& image, const CornerList& corners, int barrier,
                                       int border, float min_shi_tomasi) {
  constexpr int kHalfSize = 3;
  const int margin = std::max(border, kHalfSize + 1);
  const std::vector<int> scores = fast10_scores(image, corners.corners);
  const NonMaximumSuppression suppression(corners, scores);
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < scores.size(); ++i) {
    const Corner c = corners.corners[i];
    if (scores[i] < barrier || !image.contains(c.x, c.y, static_cast<float>(margin))) continue;
    if (!suppression.is_maximum(i)) continue;
    const float score = shi_tomasi(image, c.x, c.y, kHalfSize);
    if (score > min_shi_tomasi) candidates.push_back({c, score});
  }
  return candidates;
}

}  // namespace cairn
