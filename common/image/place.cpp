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

/// At most `count` candidates, spread over the image: the n-th best of a cell counts as a n-th of its score.
/// Cells with many strong corners have more than their share, and what is weak beside the rest of the image
/// comes last, however much of it other light brings out: the order is the same at every gain.
std::vector<Corner> spread(const std::vector<Candidate>& candidates, const GrayView& image, int count) {
  std::array<std::vector<Candidate>, size_t{kCellsAcross} * kCellsDown> cells;
  for (const Candidate& c : candidates) {
    const int column = c.corner.x * kCellsAcross / image.width;
    const int row = c.corner.y * kCellsDown / image.height;
    cells[static_cast<size_t>(row * kCellsAcross + column)].push_back(c);
  }
  const auto is_better = [](const Candidate& a, const Candidate& b) { return a.score > b.score; };
  std::vector<Candidate> ranked;
  ranked.reserve(candidates.size());
  for (auto& cell : cells) {
    std::stable_sort(cell.begin(), cell.end(), is_better);
    float rank = 0;
    for (const Candidate& c : cell) ranked.push_back({c.corner, c.score / ++rank});
  }
  std::stable_sort(ranked.begin(), ranked.end(), is_better);
  ranked.resize(std::min(ranked.size(), static_cast<size_t>(count)));
  std::vector<Corner> chosen;
  chosen.reserve(ranked.size());
  for (const Candidate& c : ranked) chosen.push_back(c.corner);
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
