// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "common/image/place.h"
#include "common/map/relocalization_answer.h"
#include "server/mapping/test_scene.h"
#include "server/relocalization/match.h"
#include "server/relocalization/place_index.h"

/// Maps of made scenes for tests, without a map maker, and what a camera sees of them.
namespace cairn::testing {

[[nodiscard]] PlaceView describe_image(const GrayView& image);

/// Scene::pose(), `advance` metres further on.
[[nodiscard]] SE3 pose_at(int step, double advance);

/// A scene in a map, and from where it was mapped.
struct MappedScene {
  const Scene* scene;
  std::vector<int> steps;  ///< of its camera
  double advance = 0;      ///< [m] further on than Scene::pose() says
  double aside = 0;        ///< [m] of the scene, in the map
  bool shares = false;     ///< keyframes measure points of those before, too
};

/// A map made without a map maker: keyframes of scenes, their corners as points at their exact places.
class ExactMap {
 public:
  ExactMap(const Scene& scene, uint8_t id, const std::vector<int>& steps, double advance = 0)
      : ExactMap(id, {{.scene = &scene, .steps = steps, .advance = advance}}) {}

  ExactMap(uint8_t id, const std::vector<MappedScene>& scenes);

  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  [[nodiscard]] const std::vector<KeyframeView>& views() const { return views_; }
  [[nodiscard]] IndexedMapPtr index() const {
    return index_map(nullptr, snapshot_, views_, GravityOptions());
  }

 private:
  void add_keyframe(const MappedScene& mapped, int step, KeyframeBlock* keyframes);
  /// Measures some of the points of each keyframe that is there.
  void share_points(const Scene& scene, const SE3& camera_from_map, KeyframeView* view) const;

  std::vector<PointSource> sources_;
  std::vector<Eigen::Vector3f> positions_;
  std::vector<KeyframeView> views_;
  MapSnapshotPtr snapshot_;
};

/// Runs the prefilter, then match_closer(), with default options.
[[nodiscard]] std::vector<PlaceMatch> match_all(const PlaceView& view, const IndexedMap& map,
                                                size_t keyframe);

/// The pose (camera_from_map) of an answer's best candidate.
[[nodiscard]] SE3 camera_of(const RelocalizationAnswer& answer, const MapSnapshot& map);

/// Distance between two cameras, over the mean depth of the keyframe nearest to `truth`.
[[nodiscard]] double error_of(const SE3& estimate, const SE3& truth, const MapSnapshot& map);

}  // namespace cairn::testing
