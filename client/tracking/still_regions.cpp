// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/still_regions.h"
#include "common/image/patch_border.h"

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <utility>

namespace cairn {
namespace {

// What a cell of the border is: of one brightness, or the rim beside it.
constexpr uint8_t kUnchanging = 1;
constexpr uint8_t kRim = 2;

size_t at(int x, int y, int width) {
  return static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
}

}  // namespace

bool StillRegions::look(const Pyramid& frame, bool has_time) {
  const bool is_turn = ++unlearnt_ >= options_.learn_every && !has_judged_;
  if (!has_time && !is_turn) return watch(frame.level(kPyramidLevels - 1));
  unlearnt_ = 0;
  return learn(frame);
}

bool StillRegions::learn(const Pyramid& frame) {
  const GrayImage& level0 = frame.level(0);
  const GrayImage& level3 = frame.level(kPyramidLevels - 1);
  if (level3.width() != width_ || level3.height() != height_) {
    *this = StillRegions(options_);
    begin(level3);
  }
  if (!last_.empty() && !has_changed(level3)) return false;
  has_judged_ |= ++looks_ >= options_.most_looks;
  detect_fast10(level0, options_.fast_threshold, &fast_);
  corners_ = find_candidates(level0, fast_, options_.barrier, kPatchBorder, options_.texture);
  columns_ = level0.width() / 2 + 1;
  rows_ = level0.height() / 2 + 1;
  if (!had_corner_.empty() && !has_moved(level0)) return false;
  mark_corners();
  count(level3);
  const bool is_first = mask_ == nullptr && frames_ >= options_.fewest_counted;
  if (!is_first && frames_ < options_.most_counted) return false;
  const StillMaskPtr before = mask_;
  find_still_corners();
  find_border();
  mask_ = make_mask();
  if (frames_ >= options_.most_counted) {
    has_judged_ = true;
    begin(level3);
  }
  return before != mask_;
}

void StillRegions::begin(const GrayImage& level3) {
  frames_ = 0;
  width_ = level3.width();
  height_ = level3.height();
  const size_t cells = static_cast<size_t>(width_) * static_cast<size_t>(height_);
  darkest_.assign(cells, 255);
  brightest_.assign(cells, 0);
  gradient_x_.assign(cells, 0);
  gradient_y_.assign(cells, 0);
  gradient_squared_.assign(cells, 0);
  std::fill(seen_.begin(), seen_.end(), uint8_t{0});
}

/// Cheaply, whether it is worth looking for corners: a camera at rest costs nothing.
bool StillRegions::has_changed(const GrayImage& level3) const {
  int64_t change = 0;
  for (int y = 0; y < height_; ++y) {
    for (int x = 0; x < width_; ++x) change += std::abs(level3.row(y)[x] - last_.row(y)[x]);
  }
  return change > static_cast<int64_t>(options_.least_mean_change) * width_ * height_;
}

bool StillRegions::has_moved(const GrayImage& level0) const {
  const int across = level0.width() / options_.square + 1;
  const int down = level0.height() / options_.square + 1;
  const auto places = static_cast<size_t>(across) * static_cast<size_t>(down);
  std::vector<int> stayed(places, 0);
  std::vector<int> all(places, 0);
  for (const auto& [c, score] : corners_) {
    const size_t place = at(c.x / options_.square, c.y / options_.square, across);
    ++all[place];
    stayed[place] += had_corner_[at(c.x / 2, c.y / 2, columns_)];
  }
  int moved = 0;
  int still = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    if (all[i] == 0) continue;
    const bool is_moved = static_cast<float>(stayed[i]) < options_.most_stay * static_cast<float>(all[i]);
    (is_moved ? moved : still) += 1;
  }
  return moved >= options_.fewest_moved && moved >= options_.moved_by_still * still;
}

void StillRegions::mark_corners() {
  had_corner_.assign(static_cast<size_t>(columns_) * static_cast<size_t>(rows_), 0);
  seen_.resize(had_corner_.size(), 0);
  for (const auto& [c, score] : corners_) {
    for (int y = std::max(0, c.y / 2 - 1); y <= std::min(rows_ - 1, c.y / 2 + 1); ++y) {
      for (int x = std::max(0, c.x / 2 - 1); x <= std::min(columns_ - 1, c.x / 2 + 1); ++x)
        had_corner_[at(x, y, columns_)] = 1;
    }
  }
}

void StillRegions::count(const GrayImage& level3) {
  ++frames_;
  last_.assign(level3);
  count_gradients(level3);
  for (size_t i = 0; i < seen_.size(); ++i) seen_[i] = static_cast<uint8_t>(seen_[i] + had_corner_[i]);
  for (int y = 0; y < height_; ++y) {
    const uint8_t* row = level3.row(y);
    for (int x = 0; x < width_; ++x) {
      const size_t i = at(x, y, width_);
      darkest_[i] = std::min(darkest_[i], row[x]);
      brightest_[i] = std::max(brightest_[i], row[x]);
    }
  }
}

void StillRegions::count_gradients(const GrayImage& level3) {
  for (int y = 1; y + 1 < height_; ++y) {
    for (int x = 1; x + 1 < width_; ++x) {
      const auto dx = static_cast<float>(level3.row(y)[x + 1] - level3.row(y)[x - 1]);
      const auto dy = static_cast<float>(level3.row(y + 1)[x] - level3.row(y - 1)[x]);
      const size_t i = at(x, y, width_);
      gradient_x_[i] += dx;
      gradient_y_[i] += dy;
      gradient_squared_[i] += dx * dx + dy * dy;
    }
  }
}

/// Whether the gradient points the same way in all frames, as where a lens shades its image off: what moves
/// has gradients that cancel.
bool StillRegions::is_rim(size_t cell) const {
  const auto n = static_cast<float>(frames_);
  const float along = gradient_x_[cell] * gradient_x_[cell] + gradient_y_[cell] * gradient_y_[cell];
  return gradient_squared_[cell] > options_.rim_gradient * options_.rim_gradient * n &&
         along > options_.coherent * n * gradient_squared_[cell];
}

StillMaskPtr StillRegions::make_mask() const {
  std::vector<uint8_t> still(border_.size());
  std::transform(border_.begin(), border_.end(), marks_.begin(), still.begin(),
                 [](uint8_t a, uint8_t b) { return a | b; });
  if (std::all_of(still.begin(), still.end(), [](uint8_t cell) { return cell == 0; })) return nullptr;
  return std::make_shared<const StillMask>(width_, height_, std::move(still));
}

bool StillRegions::watch(const GrayImage& level3) {
  if (!mask_ || level3.width() != width_ || level3.height() != height_) return false;
  bool changed = false;
  for (int y = 0; y < height_; ++y) {
    const uint8_t* row = level3.row(y);
    for (int x = 0; x < width_; ++x) {
      const size_t i = at(x, y, width_);
      if (border_[i] != kUnchanging) continue;
      border_dark_[i] = std::min(border_dark_[i], row[x]);
      border_bright_[i] = std::max(border_bright_[i], row[x]);
      if (border_bright_[i] - border_dark_[i] <= options_.most_watched) continue;
      border_[i] = 0;
      changed = true;
    }
  }
  if (changed) mask_ = make_mask();
  return changed;
}

void StillRegions::find_still_corners() {
  marks_.assign(static_cast<size_t>(width_) * static_cast<size_t>(height_), 0);
  const auto often = static_cast<uint8_t>(options_.often_seen * static_cast<float>(frames_) + 0.5F);
  constexpr int kPerCell = (1 << (kPyramidLevels - 1)) / 2;
  for (int y = 0; y < rows_; ++y) {
    for (int x = 0; x < columns_; ++x) {
      if (seen_[at(x, y, columns_)] < often) continue;
      const int cell_x = std::min(x / kPerCell, width_ - 1);
      const int cell_y = std::min(y / kPerCell, height_ - 1);
      marks_[at(cell_x, cell_y, width_)] = 1;
    }
  }
}

/// Finds the parts of the image that keep their brightness and reach its border.
void StillRegions::find_border() {
  border_.assign(darkest_.size(), 0);
  border_dark_ = darkest_;
  border_bright_ = brightest_;
  std::vector<uint8_t> change(darkest_.size());
  for (size_t i = 0; i < change.size(); ++i) change[i] = static_cast<uint8_t>(brightest_[i] - darkest_[i]);
  std::vector<uint8_t> sorted = change;
  const auto middle = sorted.begin() + static_cast<ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  if (*middle < options_.least_change) return;

  std::vector<uint8_t> visited(change.size(), 0);
  const auto is_unchanging = [&](size_t i) { return change[i] <= options_.most_change; };
  for (int y = 0; y < height_; ++y) {
    const int step = y == 0 || y == height_ - 1 ? 1 : std::max(1, width_ - 1);
    for (int x = 0; x < width_; x += step) {
      const size_t start = at(x, y, width_);
      if (visited[start] == 0 && is_unchanging(start)) add_if_framed(start, is_unchanging, &visited);
    }
  }
}

/// The cells beside one another that pass, from a first one on; those beside them that do not are added to
/// `around`.
template <typename Passes>
std::vector<size_t> StillRegions::region_from(size_t start, const Passes& passes,
                                              std::vector<uint8_t>* visited,
                                              std::vector<size_t>* around) const {
  std::vector<size_t> region;
  std::vector<size_t> next = {start};
  const auto visit = [&](int x, int y) {
    if (x < 0 || y < 0 || x >= width_ || y >= height_) return;
    const size_t i = at(x, y, width_);
    if ((*visited)[i] != 0) return;
    if (!passes(i)) {
      if (around != nullptr) around->push_back(i);
      return;
    }
    (*visited)[i] = 1;
    next.push_back(i);
  };
  (*visited)[start] = 1;
  while (!next.empty()) {
    const size_t cell = next.back();
    next.pop_back();
    region.push_back(cell);
    const int x = static_cast<int>(cell % static_cast<size_t>(width_));
    const int y = static_cast<int>(cell / static_cast<size_t>(width_));
    visit(x - 1, y);
    visit(x + 1, y);
    visit(x, y - 1);
    visit(x, y + 1);
  }
  return region;
}

/// A region of one brightness is a border if a rim frames it: the edge of a wall or a monitor moves.
template <typename Passes>
void StillRegions::add_if_framed(size_t start, const Passes& is_unchanging, std::vector<uint8_t>* visited) {
  std::vector<size_t> around;
  const std::vector<size_t> region = region_from(start, is_unchanging, visited, &around);
  const auto rim_of = [this](size_t i) { return is_rim(i); };
  const auto framed = static_cast<size_t>(std::count_if(around.begin(), around.end(), rim_of));
  if (framed < options_.fewest_framed || framed * 2 < around.size()) return;
  for (const size_t i : region) border_[i] = kUnchanging;
  for (const size_t i : around) {
    if ((*visited)[i] != 0 || !is_rim(i)) continue;
    for (const size_t j : region_from(i, rim_of, visited, nullptr)) border_[j] = kRim;
  }
}

}  // namespace cairn
