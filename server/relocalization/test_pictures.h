// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "server/relocalization/place_index.h"

namespace cairn::testing {

/// A place to be photographed: dead leaves, whose statistics are those of natural pictures (Lee et al., IJCV
/// 2001), larger than a picture.
class LeafPlace {
 public:
  static constexpr int kMargin = 16;  ///< [px of level 3] to each side of the middle picture

  explicit LeafPlace(uint64_t seed);
  /// The tiny image of the picture that lies `dx`, `dy` from the middle one, at most kMargin.
  [[nodiscard]] TinyImage view(int dx, int dy, float gain = 1) const;

 private:
  GrayImage canvas_;
};

[[nodiscard]] MapId map_id(uint32_t number);

/// A part of an index that has pictures, and words perhaps, but no points: keyframe i + 1 shows `pictures[i]`
/// and `words[i]` (ascending).
[[nodiscard]] IndexedMapPtr picture_map(const MapId& id, std::vector<TinyImage> pictures,
                                        std::vector<std::vector<WordId>> words = {});

}  // namespace cairn::testing
