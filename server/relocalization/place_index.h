// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/image/descriptor.h"
#include "common/image/tiny_image.h"
#include "common/map/keyframe_view.h"
#include "common/map/snapshot.h"
#include "server/relocalization/brightness.h"
#include "server/relocalization/compact.h"
#include "server/relocalization/picture_forest.h"
#include "server/relocalization/vocabulary.h"

/// What the relocalizer searches: tiny images and described points of all keyframes of all maps, as immutable
/// values shared between versions. Whoever changes an index makes a new one; queries go on with theirs.
namespace cairn {

/// Blur of the tiny images compared (PTAM r114).
constexpr float kPlaceBlur = 2.5F;

/// Scales at which points are described: each pyramid level and, half an octave coarser, the level reduced by
/// the square root of two. A descriptor stands a change of scale by 1.2 or so; levels alone leave gaps.
constexpr int kPlaceScales = 2 * kPyramidLevels;

/// A map point as one keyframe saw it.
struct DescribedPoint {
  PointId id;
  uint32_t measured = 0;                            ///< index into IndexedKeyframe::measured
  uint8_t level = 0;                                ///< at which it was measured
  uint8_t scale = 0;                                ///< at which it is described: 2 level, or 2 level + 1
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px of the keyframe
};

/// How a keyframe saw a point.
struct Sighting {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0
  std::optional<Brightness> brightness;             ///< there
  uint8_t level = 0;                                ///< at which it was measured
  uint8_t descriptions = 0;                         ///< how many there are: none near the border
  std::array<uint32_t, 2> described{};              ///< indices into IndexedKeyframe::points
};

struct IndexedKeyframe {
  KeyframeId id;
  CameraPtr camera;
  TinyImage tiny;                   ///< blur kPlaceBlur, zero mean
  float contrast = 0;               ///< root mean square of `tiny` [grey levels]
  std::vector<PointId> measured;    ///< ascending: what the keyframe measured when it was indexed
  std::vector<Sighting> sightings;  ///< of `measured`
  /// By the descriptor's cell, then scale, then id. Each point stands at two scales.
  std::vector<DescribedPoint> points;
  std::vector<Descriptor> descriptors;  ///< of `points`
  /// Points of cell c at scale s are [begin_of[c * kPlaceScales + s], the next one).
  std::array<uint32_t, kVocabularyCells * kPlaceScales + 1> begin_of{};
  std::vector<WordId> words;  ///< of `descriptors`, ascending, each once
};
using IndexedKeyframePtr = std::shared_ptr<const IndexedKeyframe>;

/// Which keyframes of a map show a word.
struct InvertedLists {
  std::vector<uint32_t> begin;      ///< by word: its keyframes are [begin[w], begin[w + 1]) of `keyframes`
  std::vector<uint32_t> keyframes;  ///< indices into IndexedMap::keyframes, ascending within a word
  [[nodiscard]] std::span<const uint32_t> of(WordId word) const {
    return std::span(keyframes).subspan(begin[word], begin[word + size_t{1}] - begin[word]);
  }
};

/// Whether each can be compared with each.
[[nodiscard]] bool are_comparable(std::span<const CompactPicture> pictures);

[[nodiscard]] InvertedLists invert(std::span<const IndexedKeyframePtr> keyframes);

struct IndexedMap {
  MapSnapshotPtr snapshot;                    ///< positions and poses
  std::vector<IndexedKeyframePtr> keyframes;  ///< live in `snapshot`, ascending by id
  std::vector<CompactPicture> pictures;       ///< of `keyframes`
  bool is_of_one_size = true;                 ///< all `pictures`
  InvertedLists lists;
  /// By keyframe: where the points it measured are, map frame; not finite: gone from the map.
  std::vector<std::vector<Eigen::Vector3f>> positions;

  [[nodiscard]] const Eigen::Vector3f& position(size_t keyframe, const DescribedPoint& point) const {
    return positions[keyframe][point.measured];
  }
};
using IndexedMapPtr = std::shared_ptr<const IndexedMap>;

[[nodiscard]] IndexedKeyframePtr index_keyframe(const KeyframeView& view);

/// A map's part of the index. Keyframes of `previous` (null: none) whose measurements are the same are
/// shared, and those whose view has no picture to describe them anew. Views of keyframes that the snapshot
/// does not have are left out, and those without a picture that `previous` does not have. A few milliseconds
/// per keyframe that is new or changed: not for a thread that a query waits for.
[[nodiscard]] IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                                      std::span<const KeyframeView> views);

/// More pictures than these are found sooner by a forest than by a scan (tests/bench/README.md).
constexpr size_t kMostScanned = 40'000;

/// A keyframe of an index.
struct KeyframePlace {
  const IndexedMap* map = nullptr;
  uint32_t keyframe = 0;  ///< index into those of the map
};

/// All maps. A value: copies share the maps.
class PlaceIndex {
 public:
  /// Adds a map, or replaces the one of the same id.
  void put(IndexedMapPtr map);
  void remove(const MapId& map);
  /// Ascending by id.
  [[nodiscard]] const std::vector<IndexedMapPtr>& maps() const { return maps_; }
  [[nodiscard]] const IndexedMap* find(const MapId& map) const;
  /// Those of `maps` that are here.
  [[nodiscard]] PlaceIndex only(std::span<const MapId> maps) const;
  [[nodiscard]] size_t keyframe_count() const { return keyframe_count_; }
  /// Keyframes that show a word.
  [[nodiscard]] uint32_t shown(WordId word) const { return shown_[word]; }
  /// Words that keyframes show, summed over these.
  [[nodiscard]] uint64_t shown_in_all() const { return shown_in_all_; }

  /// Whether plant_forest() would be of use: more than `most_scanned` pictures are in no forest, or more than
  /// half of those in the forest are gone.
  [[nodiscard]] bool needs_planting(size_t most_scanned = kMostScanned) const;
  /// Takes a forest made of this index or of an earlier version of it; null: all pictures are scanned.
  void set_forest(PictureForestPtr forest);
  [[nodiscard]] const PictureForestPtr& forest() const { return forest_; }
  /// By slot of the forest: whose picture that is; map null: gone.
  [[nodiscard]] std::span<const KeyframePlace> planted() const { return planted_; }
  /// What is in no forest. Ascending by map and keyframe.
  [[nodiscard]] std::span<const KeyframePlace> unplanted() const { return unplanted_; }

 private:
  /// Forgets where the keyframes of a map are, and finds out where those of `map` (null: gone) are.
  void locate(const MapId& id, const IndexedMap* map);
  /// Counts a map in (1) or out (-1).
  void count(const IndexedMap& map, int sign);

  std::vector<IndexedMapPtr> maps_;
  size_t keyframe_count_ = 0;
  std::vector<uint32_t> shown_ = std::vector<uint32_t>(kVocabularyWords);  ///< by word
  uint64_t shown_in_all_ = 0;
  PictureForestPtr forest_;
  std::vector<KeyframePlace> planted_;
  std::vector<KeyframePlace> unplanted_;
  size_t gone_ = 0;  ///< of `planted_`
};

/// A forest of all pictures of an index, or null where there are not more than `most_scanned`. A second for
/// 100 000: not for a thread that anybody waits for.
[[nodiscard]] PictureForestPtr plant_forest(const PlaceIndex& index, size_t most_scanned = kMostScanned);

}  // namespace cairn
