// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/up_direction.h"
#include "common/map/map_set.h"
#include "common/map/snapshot.h"
#include "server/relocalization/compact.h"
#include "server/relocalization/gravity.h"
#include "server/relocalization/image_forest.h"
#include "server/relocalization/indexed_keyframe.h"

/// What the relocalizer searches: the keyframes of all maps, as immutable values shared between versions.
/// Whoever changes an index makes a new one; queries go on with theirs.
namespace cairn {

/// Which keyframes of a map show a word.
struct InvertedLists {
  std::vector<uint32_t> begin;      ///< by word: its keyframes are [begin[w], begin[w + 1]) of `keyframes`
  std::vector<uint32_t> keyframes;  ///< indices into IndexedMap::keyframes, ascending within a word
  [[nodiscard]] std::span<const uint32_t> of(WordId word) const {
    return std::span(keyframes).subspan(begin[word], begin[word + size_t{1}] - begin[word]);
  }
};

/// Whether all images are of one size, so that each can be compared with each.
[[nodiscard]] bool are_comparable(std::span<const CompactImage> images);

[[nodiscard]] InvertedLists invert(std::span<const IndexedKeyframePtr> keyframes);

struct IndexedMap {
  MapSnapshotPtr snapshot;                    ///< positions and poses
  std::vector<IndexedKeyframePtr> keyframes;  ///< live in `snapshot`, ascending by id
  std::vector<CompactImage> images;           ///< of `keyframes`
  bool is_of_one_size = true;                 ///< whether all `images` are
  InvertedLists lists;
  /// For each keyframe the positions of the points that it measured, map frame; not finite if a point has
  /// gone.
  std::vector<std::vector<Eigen::Vector3f>> positions;
  std::optional<UpDirection> up;  ///< in the map frame; nothing: its keyframes do not know
};
using IndexedMapPtr = std::shared_ptr<const IndexedMap>;

/// Rough memory [byte] of a map's part of the index, with so many keyframes of 640x480 that measured so many
/// points in all.
[[nodiscard]] size_t bytes_indexed(size_t keyframes, size_t measurements);

/// Makes a map's part of the index. Keyframes are shared with `previous` (null: none; of the same images) if
/// their measurements are the same, or if their view has no image to describe them anew. Views of keyframes
/// that the snapshot does not have are left out, and those without an image that `previous` does not have. A
/// few milliseconds per keyframe that is new or changed: not for a thread that a query waits for.
[[nodiscard]] IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                                      std::span<const KeyframeView> views, const GravityOptions& gravity);

/// A keyframe of an index.
struct KeyframePlace {
  const IndexedMap* map = nullptr;
  uint32_t keyframe = 0;  ///< index into those of the map
};

/// The index of all maps. It is a value: copies share the maps.
class PlaceIndex {
 public:
  /// Adds a map, or replaces the one of the same id.
  void put(IndexedMapPtr map);
  void remove(const MapId& map);
  /// The maps, ascending by id.
  [[nodiscard]] const std::vector<IndexedMapPtr>& maps() const { return maps_; }
  [[nodiscard]] const IndexedMap* find(const MapId& map) const;
  /// An index, without a forest, of those of its maps that are among `maps`.
  [[nodiscard]] PlaceIndex only(const MapSet& maps) const;
  /// Whether all its maps are among `maps`, so that only() would leave none out.
  [[nodiscard]] bool is_within(const MapSet& maps) const;
  [[nodiscard]] size_t keyframe_count() const { return keyframe_count_; }
  /// Number of keyframes that show a word.
  [[nodiscard]] uint32_t shown(WordId word) const { return shown_[word]; }
  /// Number of words that a keyframe shows, summed over all keyframes.
  [[nodiscard]] uint64_t shown_in_all() const { return shown_in_all_; }

  /// Whether plant_forest() would be of use: more than `most_scanned` images are in no forest, or more than
  /// half of those in the forest are gone.
  [[nodiscard]] bool needs_planting(size_t most_scanned) const;
  /// Takes a forest made of this index or of an earlier version of it; null: all images are scanned.
  void set_forest(ImageForestPtr forest);
  [[nodiscard]] const ImageForestPtr& forest() const { return forest_; }
  /// For each slot of the forest the keyframe whose image it holds; its map is null if it has gone.
  [[nodiscard]] std::span<const KeyframePlace> planted() const { return planted_; }
  /// Keyframes whose images are not in the forest, ascending by map and keyframe.
  [[nodiscard]] std::span<const KeyframePlace> unplanted() const { return unplanted_; }

 private:
  /// Forgets where the keyframes of a map are, and notes where those of `map` (null: gone) are.
  void locate(const MapId& id, const IndexedMap* map);
  /// Counts a map in (1) or out (-1).
  void count(const IndexedMap& map, int sign);

  std::vector<IndexedMapPtr> maps_;
  size_t keyframe_count_ = 0;
  std::vector<uint32_t> shown_ = std::vector<uint32_t>(kVocabularyWords);  ///< by word
  uint64_t shown_in_all_ = 0;
  ImageForestPtr forest_;
  std::vector<KeyframePlace> planted_;
  std::vector<KeyframePlace> unplanted_;
  size_t gone_ = 0;  ///< number of `planted_` that have gone
};

/// A forest of all images of an index, or null where there are not more than `most_scanned`. A second for
/// 100 000: not for a thread that anybody waits for.
[[nodiscard]] ImageForestPtr plant_forest(const PlaceIndex& index, size_t most_scanned,
                                          const ForestOptions& options);

}  // namespace cairn
