// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "server/relocalization/place_index.h"

namespace cairn::testing {

/// A place to be photographed: dead leaves, whose statistics are those of natural images (Lee et al., IJCV
/// 2001), larger than an image.
class LeafPlace {
 public:
  static constexpr int kMargin = 16;  ///< [px of level 3] to each side of the middle image

  explicit LeafPlace(uint64_t seed);
  /// The tiny image of the one that lies `dx`, `dy` from the middle one, at most kMargin.
  [[nodiscard]] TinyImage view(int dx, int dy, float gain = 1) const;

 private:
  GrayImage canvas_;
};

[[nodiscard]] MapId map_id(uint32_t number);

/// A part of an index that has images, and words perhaps, but no points: keyframe i + 1 shows `images[i]`
/// and `words[i]` (ascending).
[[nodiscard]] IndexedMapPtr image_map(const MapId& id, std::vector<TinyImage> images,
                                      std::vector<std::vector<WordId>> words = {});

}  // namespace cairn::testing
