// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "common/image/descriptor.h"
#include "common/image/tiny_image.h"
#include "common/map/keyframe_view.h"
#include "common/map/snapshot.h"

/// What the relocalizer searches: tiny images and described points of all keyframes of all maps, as immutable
/// values shared between versions. Whoever changes an index makes a new one; queries go on with theirs.
namespace cairn {

/// Blur of the tiny images compared (ptam.md 1).
constexpr float kPlaceBlur = 2.5F;

/// Scales at which points are described: each pyramid level and, half an octave coarser, the level reduced by
/// the square root of two. A descriptor stands a change of scale by 1.2 or so; levels alone leave gaps.
constexpr int kPlaceScales = 2 * kPyramidLevels;

/// A map point as one keyframe saw it.
struct DescribedPoint {
  PointId id;
  uint8_t level = 0;                                ///< at which it was measured
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px of the keyframe
};

struct IndexedKeyframe {
  KeyframeId id;
  CameraPtr camera;
  TinyImage tiny;                 ///< blur kPlaceBlur, zero mean
  float contrast = 0;             ///< root mean square of `tiny` [grey levels]
  std::vector<PointId> measured;  ///< ascending: what the keyframe measured when it was indexed
  /// By scale, then id: each point measured at level l stands at scales 2 l and 2 l + 1.
  std::vector<DescribedPoint> points;
  std::vector<Descriptor> descriptors;  ///< of `points`
  /// Points of scale s are [scale_begin[s], scale_begin[s + 1]).
  std::array<size_t, kPlaceScales + 1> scale_begin{};
};
using IndexedKeyframePtr = std::shared_ptr<const IndexedKeyframe>;

struct IndexedMap {
  MapSnapshotPtr snapshot;                    ///< positions and poses
  std::vector<IndexedKeyframePtr> keyframes;  ///< live in `snapshot`, ascending by id
};
using IndexedMapPtr = std::shared_ptr<const IndexedMap>;

[[nodiscard]] IndexedKeyframePtr index_keyframe(const KeyframeView& view);

/// A map's part of the index. Keyframes of `previous` (null: none) whose measurements are the same are
/// shared. Views of keyframes that the snapshot does not have are left out. A few milliseconds per keyframe
/// that is new or changed: not for a thread that a query waits for.
[[nodiscard]] IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                                      std::span<const KeyframeView> views);

/// All maps. A value: copies share the maps.
class PlaceIndex {
 public:
  /// Adds a map, or replaces the one of the same id.
  void put(IndexedMapPtr map);
  void remove(const MapId& map);
  /// Ascending by id.
  [[nodiscard]] const std::vector<IndexedMapPtr>& maps() const { return maps_; }
  [[nodiscard]] const IndexedMap* find(const MapId& map) const;
  [[nodiscard]] size_t keyframe_count() const;

 private:
  std::vector<IndexedMapPtr> maps_;
};

}  // namespace cairn
