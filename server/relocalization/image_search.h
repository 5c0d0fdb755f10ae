// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "server/relocalization/place_index.h"

/// Which keyframes look most like a query, by the tiny images: the relocalizer's first stage.
namespace cairn {

/// A keyframe in the order of merit. Smaller cost is better.
struct Ranked {
  float cost = 0;
  const IndexedMap* map = nullptr;
  size_t keyframe = 0;  ///< index into those of the map

  [[nodiscard]] const IndexedKeyframe& indexed() const { return *map->keyframes[keyframe]; }
};

/// The tiny image of a query and what is derived of it once.
struct QueryImage {
  explicit QueryImage(TinyImage of);

  TinyImage tiny;
  float contrast = 0;  ///< as IndexedKeyframe::contrast
  CompactImage compact;
};

/// Dissimilarity of two images: 1 - Pearson's correlation of the tiny images, which gain and bias do not
/// change. 0 = alike, 1 = nothing in common; 2 without contrast; infinite for a keyframe whose tiny image has
/// another size.
[[nodiscard]] float dissimilarity(const IndexedKeyframe& keyframe, const QueryImage& query);

/// How the images of an index are searched.
enum class ImageSearch : uint8_t {
  kForest,  ///< those in the index's forest by it, the others by a scan: approximate where there is a forest
  kScan,    ///< all by a scan: exact, so an answer depends on the maps alone
};

/// A keyframe and the distance of its compact image.
struct NearImage {
  float distance = 0;
  KeyframePlace place;
};

/// Number of nearest images that a query looks at. Its words vote for keyframes of the maps of these (without
/// a bound their lists are most of the time from some thousand keyframes on), and the most alike are among
/// them.
constexpr size_t kImagesNear = 512;

/// The `images` keyframes (one at least) that are nearest to a query by their compact images. They are
/// searched once, by the constructor. Index and query have to outlive it.
class NearImages {
 public:
  NearImages(const PlaceIndex& index, const QueryImage& query, ImageSearch search,
             size_t images = kImagesNear);

  /// The `count` keyframes of the lowest dissimilarity(), best first; ties go by ids. Images of another size
  /// are not among them, and there are none for a query without contrast. Near images are compared exactly.
  /// The distance of compact images is a bound of the dissimilarity, so a scan leaves out nothing; a forest
  /// leaves out what it does not return as near.
  [[nodiscard]] std::vector<Ranked> most_similar(size_t count) const;
  /// The maps of the near images, ascending by id; all maps if the index has no more keyframes than `images`,
  /// or the query has no contrast. A map with images of another size, which cannot be compared, is always one
  /// of them.
  [[nodiscard]] std::vector<const IndexedMap*> maps() const;

 private:
  const PlaceIndex& index_;
  const QueryImage& query_;
  const bool by_forest_;
  const size_t images_;
  std::vector<NearImage> near_;  ///< nearest first
};

/// The keyframe whose tiny image has the smallest mean squared difference from the query's, which is the cost
/// (Castle et al. 2008). Null map: there is none of the query's size.
[[nodiscard]] Ranked find_nearest(const PlaceIndex& index, const TinyImage& tiny);

}  // namespace cairn
