// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/vocabulary.h"

#include <algorithm>
#include <limits>
#include <span>

namespace cairn {

CellId cell_of(const Descriptor& descriptor) {
  return static_cast<CellId>(find_nearest(descriptor, kCells).index);
}

CellList nearest_cells(const Descriptor& descriptor) {
  std::array<uint16_t, kVocabularyCells> distances;
  descriptor_distances(descriptor, kCells, distances.data());
  // Distance, then index, in 16 bits that compare as signed numbers. Each key goes into its place of the
  // best without a branch, whose outcome nothing could foretell: pushed down are all that are greater.
  std::array<int16_t, kProbedCells> best;
  best.fill(std::numeric_limits<int16_t>::max());
  for (int cell = 0; cell < static_cast<int>(kVocabularyCells); ++cell) {
    const int distance = std::min<int>(distances[static_cast<size_t>(cell)], 255);
    const auto key = static_cast<int16_t>((distance - 128) * 256 + cell);
    std::array<int16_t, kProbedCells> pushed;
    pushed[0] = std::numeric_limits<int16_t>::min();
    for (size_t i = 1; i < kProbedCells; ++i) pushed[i] = best[i - 1];
    for (size_t i = 0; i < kProbedCells; ++i) best[i] = std::max(pushed[i], std::min(best[i], key));
  }
  CellList cells;
  std::transform(best.begin(), best.end(), cells.begin(),
                 [](int16_t key) { return static_cast<CellId>(key & 0xFF); });
  return cells;
}

WordId word_in(CellId cell, const Descriptor& descriptor) {
  const size_t begin = cell * kWordsPerCell;
  const auto nearest = find_nearest(descriptor, std::span(kWords).subspan(begin, kWordsPerCell));
  return static_cast<WordId>(begin + static_cast<size_t>(nearest.index));
}

}  // namespace cairn
