// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "common/image/descriptor.h"

/// The vocabulary, which divides the Hamming space of descriptors into cells and each cell into words, so
/// that only descriptors of near cells are compared (a tree of two levels: Nister and Stewenius, CVPR 2006).
/// It is the same in every server: it is made with the program (make_vocabulary.cpp), of no recording and no
/// map.
namespace cairn {

constexpr size_t kVocabularyCells = 256;
constexpr size_t kWordsPerCell = 40;
constexpr size_t kVocabularyWords = kVocabularyCells * kWordsPerCell;

/// Centres of the cells and of the words.
extern const std::array<Descriptor, kVocabularyCells> kCells;
extern const std::array<Descriptor, kVocabularyWords> kWords;  ///< of cell c: [c * kWordsPerCell, ...)

using CellId = uint8_t;
using WordId = uint16_t;

/// Number of cells in which the corner of a query is looked for. Its point lies in one of eight with 4/5
/// probability (78 % of 43 000 pairs), among 1/24 of the points.
constexpr size_t kProbedCells = 8;
using CellList = std::array<CellId, kProbedCells>;

[[nodiscard]] CellId cell_of(const Descriptor& descriptor);
/// The nearest cells of a descriptor, nearest first; ties go to the lower index.
[[nodiscard]] CellList nearest_cells(const Descriptor& descriptor);
/// The nearest word of one cell.
[[nodiscard]] WordId word_in(CellId cell, const Descriptor& descriptor);

}  // namespace cairn
