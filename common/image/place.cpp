// SPDX-License-Identifier: Apache-2.0
#include "common/image/place.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr int kCellsAcross = 8;
constexpr int kCellsDown = 6;
// Weaker than PTAM's candidates: the same as the map maker's, whose points these corners are to meet.
constexpr int kBarrier = 6;
constexpr float kMinShiTomasi = 20;

/// At most `count` candidates, taken from the cells of the image in turn, best first.
std::vector<Corner> spread(std::vector<Candidate> candidates, const GrayView& image, int count) {
  std::array<std::vector<Candidate>, size_t{kCellsAcross} * kCellsDown> cells;
  for (const Candidate& c : candidates) {
    const int column = c.corner.x * kCellsAcross / image.width;
    const int row = c.corner.y * kCellsDown / image.height;
    cells[static_cast<size_t>(row * kCellsAcross + column)].push_back(c);
  }
  for (auto& cell : cells) {
    std::stable_sort(cell.begin(), cell.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  }
  std::vector<Corner> chosen;
  for (size_t rank = 0; static_cast<int>(chosen.size()) < count; ++rank) {
    const size_t before = chosen.size();
    for (const auto& cell : cells) {
      if (rank < cell.size() && static_cast<int>(chosen.size()) < count) chosen.push_back(cell[rank].corner);
    }
    if (chosen.size() == before) break;
  }
  return chosen;
}

}  // namespace

PlaceView describe_place(const Pyramid& pyramid, const std::array<CornerList, kPyramidLevels>& corners) {
  PlaceView view;
  view.small.assign(pyramid.level(kPyramidLevels - 1));
  GrayImage smoothed;
  for (int level = 0; level < kPyramidLevels; ++level) {
    const auto l = static_cast<size_t>(level);
    const GrayView image = pyramid.level(level);
    smooth_for_descriptors(image, &smoothed);
    const auto candidates = find_candidates(image, corners[l], kBarrier, kDescriptorRadius, kMinShiTomasi);
    for (const Corner corner : spread(candidates, image, kPlaceCorners[l])) {
      PlaceCorner& described = view.corners.emplace_back();
      described.pixel = {from_level(corner.x, level), from_level(corner.y, level)};
      described.level = static_cast<uint8_t>(level);
      if (!describe(smoothed, corner, &described.descriptor)) view.corners.pop_back();
    }
  }
  return view;
}

}  // namespace cairn
