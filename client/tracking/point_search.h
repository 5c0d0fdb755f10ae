// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "client/tracking/frustum.h"
#include "client/tracking/kept_template.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/image/patch.h"
#include "common/map/snapshot.h"

namespace cairn {

/// A map point that should be in view, and what came of looking for it.
struct VisiblePoint {
  PointId id;
  PointSlot slot;
  uint8_t level = 0;  ///< search level
  bool found = false;
  bool hidden = false;  ///< not found, and nearer points are found beside it: its absence says nothing
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  Eigen::Vector2f expected = Eigen::Vector2f::Zero();  ///< level-0 px
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();     ///< level-0 px, when found
  Warp level0_from_source = Warp::Identity();
  float depth = 0;  ///< along the optical axis [map unit]
};

/// The ways in which a point is looked for. Beyond the reach of an alignment only corners tell: there
/// kAlignment looks at them too, and kCorners does nothing.
enum class SearchBy : uint8_t {
  kAlignment,
  kCorners,  ///< after kAlignment has failed: nothing is looked for twice
  kBoth
};

/// How far and how hard a point is looked for.
struct SearchReach {
  float radius = 0;    ///< [px of level 0]
  int iterations = 0;  ///< of the refinement, at most
  SearchBy by = SearchBy::kBoth;
};

struct PointSearchOptions {
  double nearest = 1e-3;  ///< [map unit] in front of the camera (PTAM r114)
  /// [search-level px] Radius up to which a point is aligned from where it is expected.
  float alignment_reach = 5.0F;
  float least_radius = 1.5F;  ///< [search-level px] of a search, however small the radius at level 0
  KeptTemplateOptions templates;
  FrustumOptions frustum;  ///< its `nearest` is that above
};

/// Projects a map into a frame and searches its points there (PTAM 2007, sections 5.2 and 5.3). Keeps the
/// warped templates of points from frame to frame. One thread.
class PointSearch {
 public:
  explicit PointSearch(CameraPtr camera, const PointSearchOptions& options);

  /// Other values of the same camera, from now on.
  void use_camera(CameraPtr camera);

  /// Sets the revision that is searched from now on. Templates survive revisions of one epoch: what patches
  /// show never changes in it, and one whose rays were aimed anew is warped anew.
  void use_map(const MapSnapshotPtr& map);

  /// Live points that project into the image at a scale their patch allows and from a side and distance they
  /// can have been seen from: the rest can not count against quality. At most `max_points`: the coarse ones
  /// first, then a stable pseudo-random choice; `out` is ordered by level, coarsest first.
  void find_visible(const SE3& camera_from_map, int max_points, std::vector<VisiblePoint>* out);
  /// Moves `expected` to where a corrected pose projects the point; its warp is kept. False when it leaves
  /// the view.
  [[nodiscard]] bool reproject(const SE3& camera_from_map, VisiblePoint* point) const;
  /// Looks for the point where it is expected, to sub-pixel: by alignment if that reaches as far, and where
  /// it does not or fails, at the corners around; of these only what SearchReach::by asks for.
  void search(const FrameImages& frame, const SearchReach& reach, VisiblePoint* point);

 private:
  struct CachedBlock {
    PointId first;  ///< whose block it is: the tracker's own are not always in the same place
    std::array<KeptTemplate, kBlockSlots> templates;
  };

  /// A point that may be in view; the least ranks are looked for.
  struct Candidate {
    uint64_t rank = 0;
    PointSlot slot;
  };

  void collect_candidates(const SE3& camera_from_map);
  /// Projects a point. False when it is out of view, or at a scale that its patch does not allow.
  [[nodiscard]] bool project(PointSlot slot, const SE3& camera_from_map, const Eigen::Matrix3d& rotation,
                             VisiblePoint* out) const;
  [[nodiscard]] const PatchTemplate* template_of(const VisiblePoint& point, const Smear& smear);

  CameraPtr camera_;
  PointSearchOptions options_;
  Frustum frustum_;
  MapSnapshotPtr map_;
  std::vector<std::unique_ptr<CachedBlock>> templates_;
  std::vector<Candidate> candidates_;                               ///< of the frame
  std::array<std::vector<VisiblePoint>, kPyramidLevels> by_level_;  ///< of the frame
};

}  // namespace cairn
