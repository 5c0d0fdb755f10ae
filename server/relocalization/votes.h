// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "common/image/place.h"
#include "server/relocalization/place_index.h"

namespace cairn {

struct VoteOptions {
  /// Number of nearest cells of a corner, from each of which it votes by a word: the nearest cell alone has
  /// its point's word seldom (13 % of 43 000 pairs).
  uint64_t cells = 3;
};

/// A keyframe and how much its words speak for it.
struct Voted {
  float score = 0;
  const IndexedMap* map = nullptr;
  size_t keyframe = 0;  ///< index into those of the map
};

/// The keyframes with the most votes of the query's words, best first (Sivic and Zisserman, ICCV 2003). A
/// corner votes by the nearest words of several cells for every keyframe that shows one of them, with the
/// logarithm of how few keyframes show it; a word that n corners of the query show counts root n times (Jegou
/// et al., CVPR 2009). From a keyframe's sum is subtracted what its number of words gets by chance, and the
/// rest is divided by the root of that number, as its spread by chance grows: a keyframe that shows much has
/// no advantage. `cells`: of probed_cells(). `maps`: those of the index whose keyframes are voted for; how
/// rare a word is is counted over all maps. Returns at most `count`. Sums are of integers and ties go by ids.
[[nodiscard]] std::vector<Voted> vote(const PlaceIndex& index, std::span<const IndexedMap* const> maps,
                                      const PlaceView& view, std::span<const CellList> cells, size_t count,
                                      const VoteOptions& options);

}  // namespace cairn
