// SPDX-License-Identifier: Apache-2.0
#include "common/image/still_mask.h"

#include <algorithm>
#include <functional>
#include <utility>

namespace cairn {
namespace {

// How far what is looked at around a corner reaches [px of its level]: FAST's circle and the 8x8 patch.
constexpr int kReach = 4;
constexpr int kCell = 1 << (kPyramidLevels - 1);  // [px of level 0]

void remove_if(CornerList* corners, const std::function<bool(const Corner&)>& is_out) {
  size_t kept = 0;
  for (size_t y = 0; y + 1 < corners->row_begin.size(); ++y) {
    const size_t begin = corners->row_begin[y];
    corners->row_begin[y] = static_cast<uint32_t>(kept);
    for (size_t i = begin; i < corners->row_begin[y + 1]; ++i) {
      const Corner c = corners->corners[i];
      if (!is_out(c)) corners->corners[kept++] = c;
    }
  }
  if (!corners->row_begin.empty()) corners->row_begin.back() = static_cast<uint32_t>(kept);
  corners->corners.resize(kept);
}

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

size_t bytes_of_cells(int width, int height) {
  return (static_cast<size_t>(width) * static_cast<size_t>(height) + 7) / 8;
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

// What is left of an image beyond the last whole cell is as that cell.
bool StillMask::covers(const Eigen::Vector2f& pixel) const {
  const auto is_within = [](float value, int cells) {
    return cells > 0 && value >= 0 && value < static_cast<float>((cells + 1) * kCell);
  };
  return is_within(pixel.x(), width_) && is_within(pixel.y(), height_) &&
         is_still(std::min(static_cast<int>(pixel.x()) / kCell, width_ - 1),
                  std::min(static_cast<int>(pixel.y()) / kCell, height_ - 1));
}

void StillMask::remove_from(CornerList* corners, int level) const {
  const int last_x = ((width_ * kCell) >> level) - 1;
  const int last_y = ((height_ * kCell) >> level) - 1;
  remove_if(corners, [&](const Corner& c) {
    return touches(std::min<int>(c.x, last_x), std::min<int>(c.y, last_y), level);
  });
}

void StillMask::remove_covered_from(CornerList* corners, int level) const {
  remove_if(corners, [&](const Corner& c) {
    return covers({from_level(static_cast<float>(c.x), level), from_level(static_cast<float>(c.y), level)});
  });
}

std::vector<uint8_t> bits_of(const StillMaskPtr& mask) {
  if (mask == nullptr) return {};
  const int width = mask->width();
  std::vector<uint8_t> bits(bytes_of_cells(width, mask->height()), 0);
  for (int y = 0; y < mask->height(); ++y) {
    for (int x = 0; x < width; ++x) {
      const auto cell = static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
      if (mask->is_still(x, y)) bits[cell / 8] |= static_cast<uint8_t>(1 << cell % 8);
    }
  }
  return bits;
}

size_t still_mask_bytes(int image_width, int image_height) {
  return bytes_of_cells(image_width / kCell, image_height / kCell);
}

StillMaskPtr still_mask_of(int image_width, int image_height, std::span<const uint8_t> bits) {
  if (bits.size() != still_mask_bytes(image_width, image_height)) return nullptr;
  const int width = image_width / kCell;
  const int height = image_height / kCell;
  std::vector<uint8_t> still(static_cast<size_t>(width) * static_cast<size_t>(height));
  for (size_t cell = 0; cell < still.size(); ++cell) still[cell] = bits[cell / 8] >> cell % 8 & 1;
  if (std::all_of(still.begin(), still.end(), [](uint8_t cell) { return cell == 0; })) return nullptr;
  return std::make_shared<const StillMask>(width, height, std::move(still));
}

}  // namespace cairn
