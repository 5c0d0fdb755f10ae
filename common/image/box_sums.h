// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/base/reset_on_move.h"
#include "common/image/image.h"
#include "common/image/patch.h"

namespace cairn {

/// Box sums: what every 8x8 window of an image adds to a ZMSSD whatever the template, the sums of its pixels
/// and of their squares. 6 bytes a pixel. Immutable.
class BoxSums {
 public:
  explicit BoxSums(const GrayView& image);

  /// How many windows lie side by side, and one below the other: none where the image is smaller than one.
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  /// The sums of the windows in row `top`: the first belongs to the window whose upper left pixel is (left,
  /// top), the next ones to those right of it. squares() likewise.
  [[nodiscard]] const uint16_t* sums(int left, int top) const { return &sums_[index(left, top)]; }
  [[nodiscard]] const int32_t* squares(int left, int top) const { return &squares_[index(left, top)]; }

 private:
  [[nodiscard]] size_t index(int left, int top) const {
    return static_cast<size_t>(top) * static_cast<size_t>(width_) + static_cast<size_t>(left);
  }

  ResetOnMove<int> width_;
  ResetOnMove<int> height_;
  std::vector<uint16_t> sums_;
  std::vector<int32_t> squares_;
};

/// Pixels side by side in one row, `first` to `last`; none where last < first.
struct PixelRun {
  int row = 0;
  int first = 0;
  int last = -1;
};

/// Appends the pixels of the runs, in their order, where the template fits with a zmssd_at() below `limit`.
/// Each of them lowers `limit` to 1 / ratio (in (0, 1]) of its own: what is farther from it can neither be
/// the best nor its rival. All windows must lie inside the image, of which `sums` are. Vectorized, exact
/// integers.
void search_zmssd(const PatchTemplate& patch, const GrayView& level_image, const BoxSums& sums,
                  std::span<const PixelRun> runs, float ratio, int* limit, std::vector<PatchMatch>* out);
/// The same search without box sums. Each window costs more, but a few windows cost less than the sums of an
/// image.
void search_zmssd(const PatchTemplate& patch, const GrayView& level_image, std::span<const PixelRun> runs,
                  float ratio, int* limit, std::vector<PatchMatch>* out);

}  // namespace cairn
