// SPDX-License-Identifier: Apache-2.0
#include "common/image/still_mask.h"

#include <algorithm>
#include <utility>

namespace cairn {
namespace {

// How far what is looked at around a corner reaches [px of its level]: FAST's circle and the 8x8 patch.
constexpr int kReach = 4;
constexpr int kCell = 1 << (kPyramidLevels - 1);  // [px of level 0]

/// `bit` in every cell at most `radius` cells from one that stands still.
void mark_around(const StillMask& mask, int radius, uint8_t bit, std::vector<uint8_t>* touched) {
  const int width = mask.width();
  for (int y = 0; y < mask.height(); ++y) {
    for (int x = 0; x < width; ++x) {
      if (!mask.is_still(x, y)) continue;
      for (int v = std::max(0, y - radius); v <= std::min(mask.height() - 1, y + radius); ++v) {
        for (int u = std::max(0, x - radius); u <= std::min(width - 1, x + radius); ++u)
          (*touched)[static_cast<size_t>(v) * static_cast<size_t>(width) + static_cast<size_t>(u)] |= bit;
      }
    }
  }
}

}  // namespace

StillMask::StillMask(int width, int height, std::vector<uint8_t> still)
    : width_(width), height_(height), still_(std::move(still)), touched_(still_.size(), 0) {
  for (int level = 0; level < kPyramidLevels; ++level) {
    const int radius = ((kReach << level) + kCell - 1) / kCell;
    mark_around(*this, radius, static_cast<uint8_t>(1 << level), &touched_);
  }
}

size_t StillMask::still_cells() const {
  return static_cast<size_t>(
      std::count_if(still_.begin(), still_.end(), [](uint8_t cell) { return cell != 0; }));
}

void StillMask::remove_from(CornerList* corners, int level) const {
  size_t kept = 0;
  for (size_t y = 0; y + 1 < corners->row_begin.size(); ++y) {
    const size_t begin = corners->row_begin[y];
    corners->row_begin[y] = static_cast<uint32_t>(kept);
    for (size_t i = begin; i < corners->row_begin[y + 1]; ++i) {
      const Corner c = corners->corners[i];
      if (!touches(c.x, c.y, level)) corners->corners[kept++] = c;
    }
  }
  if (!corners->row_begin.empty()) corners->row_begin.back() = static_cast<uint32_t>(kept);
  corners->corners.resize(kept);
}

}  // namespace cairn
