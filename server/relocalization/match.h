// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "common/geometry/pose.h"
#include "common/image/place.h"
#include "server/relocalization/place_index.h"

/// Corners of a query matched with points of keyframes by their descriptors.
namespace cairn {

/// A corner of the query and the map point that it shows, perhaps.
struct PlaceMatch {
  size_t corner = 0;  ///< index into PlaceView::corners
  PointId point;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  int distance = 0;
};

/// Every corner with the point of the keyframe that looks most like it, at its own pyramid level and one up
/// or down. Kept are matches clearly better than the best rival elsewhere in the keyframe; each point once.
/// Points that left the map are passed over. In the order of corners.
[[nodiscard]] std::vector<PlaceMatch> match_anywhere(const PlaceView& view, const IndexedKeyframe& keyframe,
                                                     const MapSnapshot& snapshot);

/// Corners in square cells, to find those near a pixel.
class CornerGrid {
 public:
  CornerGrid(const PlaceView& view, const Camera& camera);
  /// Corners within `radius` level-0 px, in order of the grid.
  void find(const Eigen::Vector2d& pixel, double radius, std::vector<size_t>* out) const;

 private:
  static constexpr int kCell = 16;  ///< px
  const PlaceView* view_;
  int columns_ = 0;
  int rows_ = 0;
  std::vector<std::vector<size_t>> cells_;
};

/// Points of keyframes looked for where a pose projects them, within `radius` px of the corner's level. Each
/// corner and each point at most once. `expected`: how many points project into the image.
struct GuidedMatches {
  std::vector<PlaceMatch> matches;
  size_t expected = 0;
};
[[nodiscard]] GuidedMatches match_by_pose(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                                          const SE3& camera_from_map, const IndexedMap& map,
                                          std::span<const IndexedKeyframePtr> keyframes, double radius);

/// As observations of a pose: sigma 2^level px.
[[nodiscard]] std::vector<PointObservation> to_observations(const PlaceView& view,
                                                            std::span<const PlaceMatch> matches);

}  // namespace cairn
