// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/vocabulary.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <span>
#include <vector>

namespace cairn {
namespace {

std::vector<Descriptor> random_descriptors(size_t count) {
  std::mt19937_64 random(3);
  std::vector<Descriptor> descriptors(count);
  for (Descriptor& d : descriptors) {
    for (uint64_t& word : d) word = random();
  }
  return descriptors;
}

TEST(Vocabulary, TheNearestCellsAreTheNearest) {
  for (const Descriptor& d : random_descriptors(300)) {
    std::vector<std::pair<int, int>> all;
    for (size_t c = 0; c < kCells.size(); ++c)
      all.emplace_back(descriptor_distance(d, kCells[c]), static_cast<int>(c));
    std::sort(all.begin(), all.end());
    const CellList nearest = nearest_cells(d);
    for (size_t i = 0; i < nearest.size(); ++i) ASSERT_EQ(nearest[i], all[i].second) << i;
    ASSERT_EQ(cell_of(d), nearest[0]);
  }
}

TEST(Vocabulary, AWordOfACellIsTheNearestThere) {
  for (const Descriptor& d : random_descriptors(300)) {
    const CellId cell = cell_of(d);
    const WordId word = word_in(cell, d);
    ASSERT_EQ(word / kWordsPerCell, cell);
    for (size_t other = cell * kWordsPerCell; other < (cell + size_t{1}) * kWordsPerCell; ++other)
      ASSERT_LE(descriptor_distance(d, kWords[word]), descriptor_distance(d, kWords[other]));
  }
}

TEST(Vocabulary, NoCellIsIdleAndNoWordStrays) {
  std::vector<Descriptor> cells(kCells.begin(), kCells.end());
  std::sort(cells.begin(), cells.end());
  EXPECT_EQ(std::adjacent_find(cells.begin(), cells.end()), cells.end()) << "each centre is there once";
  // Words are medians of what lies in their cell, so most lie in it themselves.
  size_t at_home = 0;
  for (size_t w = 0; w < kWords.size(); ++w) at_home += cell_of(kWords[w]) == w / kWordsPerCell ? 1 : 0;
  EXPECT_GT(at_home, kVocabularyWords * 3 / 4);
}

}  // namespace
}  // namespace cairn
