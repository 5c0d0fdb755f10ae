// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "client/tracking/kept_template.h"
#include "client/tracking/local_map.h"
#include "client/tracking/point_search.h"
#include "client/tracking/pose_judgement.h"
#include "common/geometry/camera.h"
#include "common/geometry/pose.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/image/patch.h"
#include "common/map/observations.h"
#include "common/map/snapshot.h"

namespace cairn {

struct ProvisionalPointsOptions {
  /// Levels. The corners of level 0 cost a fifth of a frame's time; those of the two levels above are good to
  /// the fraction of a degree that is asked of them.
  int finest_level = 1;
  int coarsest_level = 2;
  int cell_limit = 4;        ///< points in a cell; 48 cells have 192
  int begin_every = 3;       ///< [frames] a pan of 150 degrees/s turns by 15 degrees meanwhile
  float neighbour = 6;       ///< [px of level 0] nearer than that two corners are one
  float least_texture = 70;  ///< Shi-Tomasi's measure, as of keyframe candidates (PTAM r114)
  int oldest = 900;          ///< [frames] then it is dropped: a map that has not grown there by then will not
  int unseen_limit = 60;     ///< [frames] out of view
  int miss_limit = 8;        ///< [frames] in view and not found
  int refusals = 2;          ///< in a row: it moves, or was mistaken
  int iterations = 8;        ///< of an alignment
  float coarse_radius = 20;  ///< [px of level 0]
  float fine_radius = 6;     ///< [px of level 0]
  uint64_t fewest_coarse = 6;     ///< found, to say where the camera has turned to
  uint64_t fewest_bearings = 15;  ///< that agree on a pose
  /// [sigma^2] Tukey's cut-off, at least, as the pose finder's: matches are good to a third of their sigma,
  /// so the floor is the rule.
  double min_squared_cutoff = 1.0;
  double max_squared_cutoff = 9.0;  ///< [sigma^2]
  double measured_sigma = 0.3;      ///< [search-level px] of an aligned patch
  double gate = 9.21;               ///< squared innovation of 2 degrees of freedom: 99 % of chi-square
  /// Least distance between the cameras of two measurements of a depth, over the mean depth: from nearer the
  /// same errors would be measured twice.
  double news_distance = 0.003;
  /// Sigma of the position's prior where it is to be measured, over the mean depth: without a prior, what is
  /// not measured is singular.
  double free_position = 1;
  /// Likewise, over the depth, where the camera only turns and keeps its place.
  double turned_only = 1e-3;
  double point_depth = 0.05;  ///< sigma of the inverse depth over itself, of what becomes a point
  /// Least inverse depth, over the prior's: in front of the camera, however far.
  double least_inverse = 1e-6;
  /// Sigma of a depth that is known, over the depth: above, the prior speaks, and it errs for all corners of
  /// a wall alike.
  double known_depth = 0.2;
  KeptTemplateOptions templates;
};

/// Corners that the map has no points of, followed with known poses: each a bearing from where it was seen
/// first, and an inverse depth with its variance (Civera, Davison and Montiel, T-RO 2008). They hold the
/// rotation while the camera turns away from its map (Pirchheim, Schmalstieg and Reitmayr, ISMAR 2013), and
/// the position as far as their depths are known. Poses are kept relative to keyframes, so they survive
/// adjustments of the map. Bounded in number and age; no memory is taken once as many were followed as
/// there can be. Pure; one thread; equal inputs give equal bytes.
class ProvisionalPoints {
 public:
  static constexpr size_t kMostPoints = 200;

  explicit ProvisionalPoints(CameraPtr camera, const ProvisionalPointsOptions& options,
                             const PoseJudgementOptions& judgement);

  /// Other values of the same camera, from now on: what was seen with the old ones is forgotten.
  void use_camera(CameraPtr camera);
  void clear();

  /// Looks for all of them in a frame: the coarse ones around where `predicted` puts them, the others where
  /// the coarse ones say that the camera has turned to. Those begun in another map are forgotten.
  void follow(const FrameImages& now, const SE3& predicted, const MapSnapshot& map);
  /// The points found by the latest follow(), as bearings in the frame of its map.
  [[nodiscard]] std::span<const BearingObservation> observations() const { return observations_; }

  /// A frame's pose by the map's points that were found in it and by those followed.
  struct Located {
    SE3 camera_from_map;
    Matrix6d covariance = Matrix6d::Identity();
    PoseJudgement judgement;
    size_t bearings = 0;  ///< that agree
  };
  /// The pose of the frame of the latest follow(). The position stays that of `start` where it is not
  /// determined. Nothing where not even the rotation is determined, where too few bearings agree, or less
  /// than half of those found.
  [[nodiscard]] std::optional<Located> locate(const SE3& start, std::span<const VisiblePoint> map_points,
                                              double mean_depth);

  /// A frame's pose that is believed.
  struct KnownPose {
    SE3 camera_from_map;
    Matrix6d covariance = Matrix6d::Zero();  ///< left tangent
    PoseSupport support = PoseSupport::kPosition;
    double mean_depth = 1;  ///< [map unit] of what it shows
  };
  /// The frame of the latest follow() has this pose: depths are measured, where its position is known; a
  /// point that does not agree `refusals` times in a row is dropped; corners are begun where neither the map
  /// nor any of them has a point.
  void update(const FrameImages& now, const KnownPose& pose, const MapSnapshot& map,
              std::span<const VisiblePoint> map_points);

  /// The points that were found in the frame of the latest update() and whose depths are known there, in its
  /// camera: a map maker can make map points of them. At most kMostPoints.
  [[nodiscard]] std::vector<PointCandidate> candidates(const SE3& camera_from_map) const;

  /// A point that is followed, for tests.
  struct Followed {
    CandidateId id;
    SE3 anchor_from_map;                                 ///< the camera that saw it first
    Eigen::Vector3d bearing = Eigen::Vector3d::UnitZ();  ///< unit, in that camera
    double inverse_depth = 0;                            ///< along it [1 / map unit]
    double variance = 0;                                 ///< of the inverse depth
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();     ///< level 0, where found last
    uint8_t level = 0;
    bool found = false;      ///< in the latest frame
    double innovation = -1;  ///< squared, over its variance, 1 degree of freedom; < 0: depth not measured
  };
  [[nodiscard]] size_t size() const { return points_.size(); }
  [[nodiscard]] Followed at(size_t i) const;

  /// Appends those found in the latest frame whose depth is known to a twentieth, as points of the map that
  /// the tracker makes for itself; here they stay.
  void known(std::vector<LocalPoint>* out) const;
  /// Appends where the points of the map and those followed here were found in the latest frame, all that
  /// agree with its pose.
  void measurements(std::span<const VisiblePoint> map_points, std::vector<LocalMeasurement>* out) const;
  /// Forgets the points with these numbers: they have become points elsewhere.
  void forget(std::span<const uint64_t> numbers);

 private:
  static constexpr size_t kMostAnchors = 64;
  static constexpr int kColumns = 8;  ///< of cells
  static constexpr int kRows = 6;

  /// A camera that began points.
  struct Anchor {
    KeyframeId reference;
    SE3 camera_from_reference;
    int points = 0;                                           ///< that it began and that are left; 0: free
    SE3 anchor_from_map;                                      ///< in the present revision
    Eigen::Vector3d measured_from = Eigen::Vector3d::Zero();  ///< where depths were measured last, in it
  };
  struct Point {
    CandidateId id;
    size_t anchor = 0;
    Eigen::Vector3d bearing;
    Eigen::Vector3d right;  ///< from the bearing to the next pixel of the level, and
    Eigen::Vector3d down;   ///< to the one below, on a surface that faces the camera
    double inverse_depth = 0;
    double variance = 0;
    uint8_t level = 0;
    int age = 0;      ///< [frames]
    int unseen = 0;   ///< frames since it was found last
    int refused = 0;  ///< in a row, by its innovation
    bool found = false;
    bool in_view = false;
    double innovation = -1;
    Eigen::Vector2f expected = Eigen::Vector2f::Zero();
    Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
    int search_level = 0;
    Warp warp = Warp::Zero();
    KeptTemplate kept;
    SourcePatch source;
    Eigen::Vector2f smear = Eigen::Vector2f::Zero();  ///< [px of level 0] that `source` has
  };

  void aim_anchors(const MapSnapshot& map);
  void drop(size_t i);
  void drop_aged();
  void project(const SE3& camera_from_map, Point* point);
  void search(const FrameImages& now, float radius, bool asks_corners, Point* point);
  [[nodiscard]] SE3 follow_coarse(const FrameImages& now, const SE3& predicted);
  void observe();
  void measure(const KnownPose& pose);
  /// Measures a point's inverse depth by a pose. False when the point does not agree with the pose.
  [[nodiscard]] bool measure(const KnownPose& pose, const SE3& camera_from_anchor, bool is_news,
                             Point* point);
  void fill_cells(std::span<const VisiblePoint> map_points);
  void begin(const FrameImages& now, const KnownPose& pose, const MapSnapshot& map);
  void begin_level(const FrameImages& now, const KnownPose& pose, int level, size_t anchor);
  [[nodiscard]] bool begin_point(const FrameImages& now, const KnownPose& pose, int level, Corner corner,
                                 size_t anchor);
  [[nodiscard]] bool make_room();
  [[nodiscard]] std::optional<size_t> new_anchor(const KnownPose& pose, const MapSnapshot& map);
  [[nodiscard]] size_t cell_of(const Eigen::Vector2f& pixel) const;
  [[nodiscard]] bool has_neighbour(const Eigen::Vector2f& pixel) const;

  CameraPtr camera_;
  ProvisionalPointsOptions options_;
  PoseJudgementOptions judgement_;
  std::optional<MapId> map_;
  std::vector<Point> points_;
  std::array<Anchor, kMostAnchors> anchors_;
  std::array<int, size_t{kColumns} * kRows> cells_{};  ///< points in each
  int frames_unbegun_ = 0;                             ///< since corners were begun last
  CandidateId last_id_;
  std::vector<BearingObservation> observations_;
  std::vector<PointObservation> of_map_;
  PoseWorkspace workspace_;
  PoseEstimate estimate_;
};

}  // namespace cairn
