// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "common/map/ids.h"
#include "server/relocalization/compact.h"

namespace cairn {

struct ForestOptions {
  int trees = 4;
  int checks = 4096;  ///< images compared before a search ends (recall and time: tests/bench)
};

/// Finds the nearest of many compact images by FLANN's randomized kd-trees (Muja and Lowe, PAMI 2014). It is
/// approximate, so more are asked for than are wanted and compared exactly afterwards. Immutable; any number
/// of threads may ask. The trees are drawn from the machine's entropy (FLANN 1.9.2 takes no seed), so what is
/// left out differs from one planting to the next.
class ImageForest {
 public:
  struct Image {
    MapId map;
    KeyframeId keyframe;
    CompactImage compact;
  };
  /// The keyframe whose image a slot was made of.
  struct Slot {
    MapId map;
    KeyframeId keyframe;
    friend auto operator<=>(const Slot&, const Slot&) = default;
  };
  struct Found {
    float distance = 0;  ///< compact_distance()
    uint32_t slot = 0;
  };

  /// Plants trees for the images of each size. `images` are ascending by map and keyframe, each once. Takes a
  /// second for 100 000: not for a thread that anybody waits for.
  ImageForest(std::span<const Image> images, const ForestOptions& options);
  ~ImageForest();
  ImageForest(const ImageForest&) = delete;
  ImageForest& operator=(const ImageForest&) = delete;

  /// The slots, in the order of the images that the forest was made of.
  [[nodiscard]] const std::vector<Slot>& slots() const { return slots_; }
  /// The image that a slot was made of.
  [[nodiscard]] const CompactImage& image(size_t slot) const { return *rows_[slot]; }
  /// At most `count` slots near the query, of its size and for which `is_there` holds, ascending by distance.
  [[nodiscard]] std::vector<Found> find(const CompactImage& query, size_t count,
                                        const std::function<bool(uint32_t slot)>& is_there) const;
  [[nodiscard]] size_t bytes() const;

 private:
  class Trees;
  std::vector<Slot> slots_;
  std::vector<const CompactImage*> rows_;            ///< of `trees_`, by slot
  std::vector<std::unique_ptr<const Trees>> trees_;  ///< one for each size of image
};
using ImageForestPtr = std::shared_ptr<const ImageForest>;

}  // namespace cairn
