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
  Eigen::Vector2f there = Eigen::Vector2f::Zero();  ///< where the keyframe saw it [level-0 px]
};

/// For each corner of a view the cells in which points are looked for that may be the same.
[[nodiscard]] std::vector<CellList> probed_cells(const PlaceView& view);

/// Every corner with the point of the keyframe that looks most like it, of those in the corner's cells at its
/// own pyramid level and one up or down. Kept are matches clearly better than the best rival elsewhere in the
/// keyframe; each point once. Points that left the map are passed over. In the order of corners.
[[nodiscard]] std::vector<PlaceMatch> match_anywhere(const PlaceView& view, std::span<const CellList> cells,
                                                     const IndexedMap& map, size_t keyframe);

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

/// A point of a keyframe where a pose puts it in the query.
struct ProjectedPoint {
  const IndexedKeyframe* keyframe = nullptr;
  size_t index = 0;                                    ///< into its `points`
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();     ///< level 0
  double depth = 0;                                    ///< [map unit] in the query's camera
};
/// Those in the image, of some keyframes of the map (indices); a point stands once for each scale at which it
/// is described. `out` keeps its memory.
void project_points(const Camera& camera, const SE3& camera_from_map, const IndexedMap& map,
                    std::span<const size_t> keyframes, std::vector<ProjectedPoint>* out);

/// Projected points looked for within `radius` px of the corner's level. Each corner and each point at most
/// once.
struct GuidedMatches {
  std::vector<PlaceMatch> matches;
  size_t expected = 0;  ///< different points
  size_t met = 0;       ///< corners on which a point of about their level falls, whether alike or not
};
[[nodiscard]] GuidedMatches match_near(const PlaceView& view, const CornerGrid& grid,
                                       std::span<const ProjectedPoint> points, double radius);

/// Matches that moved from the keyframe's picture to the query's as at least two of their neighbours did (the
/// idea of grid-based motion statistics: Bian et al., CVPR 2017). Of false matches few do, by chance:
/// sampling from these finds a pose in tens of trials where sampling from all needs thousands. In the given
/// order.
[[nodiscard]] std::vector<PlaceMatch> keep_supported(const PlaceView& view,
                                                     std::span<const PlaceMatch> matches);

/// As observations of a pose: sigma 2^level px.
[[nodiscard]] std::vector<PointObservation> to_observations(const PlaceView& view,
                                                            std::span<const PlaceMatch> matches);

}  // namespace cairn
