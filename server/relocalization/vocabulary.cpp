// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/vocabulary.h"

#include <algorithm>
#include <limits>
#include <span>

#include "common/base/simd.h"

namespace cairn {

CellId cell_of(const Descriptor& descriptor) {
  return static_cast<CellId>(find_nearest(descriptor, kCells).index);
}

CellList nearest_cells(const Descriptor& descriptor) {
  std::array<uint16_t, kVocabularyCells> distances;
  descriptor_distances(descriptor, kCells, distances.data());
  // Keys are distance, then index, in 16 bits that compare as signed numbers: of equal distances the lower
  // index comes first. A distance of 256, all bits different, would not fit and counts as 255: a tie that
  // would tell only if nearly all cells were alike. Each goes into its place among the eight least without a
  // branch, whose outcome nothing could foretell: what is greater moves up by one. Even and odd cells go by
  // themselves, since each step waits for the one before.
  static_assert(kProbedCells == 8 && kVocabularyCells == 256, "a vector of keys of 16 bits");
  const I16x8 least = {std::numeric_limits<int16_t>::min()};
  const auto insert = [&](int16_t key, I16x8* best) {
    const I16x8 moved_up = move_up(*best) | least;
    const I16x8 keys = I16x8{} + key;
    const I16x8 lower = *best < keys ? *best : keys;
    *best = moved_up > lower ? moved_up : lower;
  };
  const auto key_of = [&](int cell) {
    const int distance = std::min<int>(distances[static_cast<size_t>(cell)], 255);
    return static_cast<int16_t>((distance - 128) * 256 + cell);
  };
  I16x8 even = I16x8{} + std::numeric_limits<int16_t>::max();
  I16x8 odd = even;
  for (int cell = 0; cell < static_cast<int>(kVocabularyCells); cell += 2) {
    insert(key_of(cell), &even);
    insert(key_of(cell + 1), &odd);
  }
  std::array<int16_t, kProbedCells> keys;
  store_lanes(keys.data(), odd);
  for (const int16_t key : keys) insert(key, &even);
  store_lanes(keys.data(), even);
  CellList cells;
  std::ranges::transform(keys, cells.begin(), [](int16_t key) { return static_cast<CellId>(key & 0xFF); });
  return cells;
}

WordId word_in(CellId cell, const Descriptor& descriptor) {
  const size_t begin = cell * kWordsPerCell;
  const auto nearest = find_nearest(descriptor, std::span(kWords).subspan(begin, kWordsPerCell));
  return static_cast<WordId>(begin + static_cast<size_t>(nearest.index));
}

}  // namespace cairn
