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
  std::array<uint32_t, kProbedCells> best;  // distance, then index
  best.fill(std::numeric_limits<uint32_t>::max());
  for (uint32_t cell = 0; cell < kVocabularyCells; ++cell) {
    const uint32_t key = uint32_t{distances[cell]} << 8 | cell;
    if (key >= best.back()) continue;
    size_t at = kProbedCells - 1;
    for (; at > 0 && best[at - 1] > key; --at) best[at] = best[at - 1];
    best[at] = key;
  }
  CellList cells;
  std::transform(best.begin(), best.end(), cells.begin(),
                 [](uint32_t key) { return static_cast<CellId>(key & 0xFF); });
  return cells;
}

WordId word_in(CellId cell, const Descriptor& descriptor) {
  const size_t begin = cell * kWordsPerCell;
  const auto nearest = find_nearest(descriptor, std::span(kWords).subspan(begin, kWordsPerCell));
  return static_cast<WordId>(begin + static_cast<size_t>(nearest.index));
}

}  // namespace cairn
