// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "client/tracking/point_search.h"
#include "client/tracking/stage.h"
#include "common/geometry/camera.h"
#include "common/geometry/depth_order.h"
#include "common/geometry/pose.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

namespace cairn {

struct TrackerOptions;

struct PoseFinderOptions {
  int max_points = 1100;     ///< searched per frame; PTAM r114 has 1000, of which sim-desk shows 490
  int coarse_points = 60;    ///< points of the coarse stage (PTAM r114)
  float coarse_radius = 30;  ///< [px of level 0] (PTAM r114)
  float fine_radius = 10;    ///< [px of level 0] without a coarse stage before (PTAM r114)
  float fine_radius_after_coarse = 5;  ///< [px of level 0] (PTAM r114)
  /// Level from which on points are of the coarse stage (PTAM r114: the two top levels).
  int coarse_level = 2;
  int coarse_available = 20;  ///< points: fewer and the coarse stage is left out (PTAM r114)
  int coarse_found = 12;      ///< points: fewer and its pose is not believed (PTAM: 20 of 60)
  /// Share of the points searched that alignment must find for corners not to be asked. Corners find a few
  /// points in a hundred that alignment does not, for a quarter of the frame's time: they are asked where
  /// alignment finds less, as in blur and where the coarse pose is off.
  float enough_aligned = 0.4F;
  int refine_iterations = 8;  ///< of an alignment (PTAM r114)
  int large_attempted = 10;  ///< points of the coarse levels: with fewer their share says nothing (PTAM r114)
  int fewest_found = 15;     ///< inliers below which no pose is believed
  float least_quality = 0.1F;  ///< so few of those in sight agree by chance, whatever the top levels say
  /// [sigma^2] Tukey's cut-off, at least: sub-pixel matches at level 0 are good to 0.3 px.
  double min_squared_cutoff = 1.0;
  /// [sigma^2] Tukey's cut-off, at most. Where half of the matches are false (stripes, tiles, blur), their
  /// median is no measure of the noise, and a cut-off from it lets them bend the pose by centimetres. A map
  /// that does not fit so well is tracked by the second attempt, which has no ceiling.
  double max_squared_cutoff = 9.0;
  /// [sigma] RMS of the inliers of a pose that is believed, at most. In the experiments no right pose had
  /// more than 1.5; those of the second attempt with more than 5 were 5 to 40 cm off.
  double most_rms = 3.0;
  /// Share of the quality of the frame before, below which the coarse stage is doubted: fewer points are
  /// found as things leave the image and blur comes, but not so many fewer from one frame to the next.
  float least_of_quality_expected = 0.7F;
  float widen = 2.0F;  ///< factor of the second attempt's radius and points (PTAM r114)
  /// A point this many times as deep as points found beside it stands behind the thing they are on. Across
  /// the cells of DepthOrder a plane turned by 50 degrees differs by less, even at the far edge of a view of
  /// 50 degrees.
  float behind = 1.4F;
  PointSearchOptions points;
};

/// How far and for how many points a frame is searched.
struct SearchEffort {
  int coarse_points = 0;
  float coarse_radius = 0;  ///< [px of level 0]
  float fine_radius = 0;    ///< [px of level 0] without a coarse stage before
  float fine_radius_after_coarse = 0;
  double max_squared_cutoff = std::numeric_limits<double>::infinity();  ///< Tukey's [sigma^2]
  /// Share of the points that alignment must find for corners not to be asked; 1: they always are.
  float enough_aligned = 1;
  bool needs_coarse = false;  ///< gives up when the coarse stage, which is cheap, finds no pose
  /// Whether the search looks again without the coarse stage where that does not lead to a good pose, or
  /// leads to much less than the quality expected. The pose with more points is taken.
  bool doubts_coarse = false;
  float expected_quality = 0;  ///< that of the frame before; 0: unknown
};
[[nodiscard]] SearchEffort normal_effort(const TrackerOptions& options);
/// `widen` times the points and radii (PTAM r114: twice), and no ceiling of the cut-off: for the second
/// attempt, and for a camera that is lost. After a coarse stage the radius is `fine_radius`.
[[nodiscard]] SearchEffort wide_effort(const TrackerOptions& options);

enum class PoseVerdict : uint8_t { kGood, kPoor, kBad };

/// Finds the pose of a frame in a map from a rough one: the coarse and the fine stage of PTAM 2007, section
/// 5.5. All that it tells after locate() is about the latest call. Memory is reused from frame to frame. One
/// thread.
class PoseFinder {
 public:
  PoseFinder(CameraPtr camera, const TrackerOptions& options);

  /// Sets the revision that is searched from now on.
  void use_map(const MapSnapshotPtr& map) { search_.use_map(map); }
  /// Other values of the same camera, from now on.
  void use_camera(const CameraPtr& camera) {
    camera_ = camera;
    search_.use_camera(camera);
  }
  /// Forgets what the frame before was found to show.
  void clear();

  [[nodiscard]] std::optional<SE3> locate(const FrameImages& frame, const SE3& start,
                                          const SearchEffort& effort, StageProbe* probe);
  /// The pose that the points found agree on.
  [[nodiscard]] const std::optional<SE3>& located() const { return seen_.camera_from_map; }
  /// How far the pose located is to be believed: by the share of the points found and, where that is low, of
  /// those on the two top levels, which stand blur.
  [[nodiscard]] PoseVerdict judge() const;

  [[nodiscard]] int attempted() const { return seen_.attempted; }
  [[nodiscard]] int found() const { return seen_.found; }  ///< inliers of the pose
  /// The share found of those attempted, without those that others hide.
  [[nodiscard]] float quality() const;
  [[nodiscard]] double rms() const {
    return seen_.rms;
  }  ///< [px of level 0, scaled by 2^-level] of the inliers
  /// Covariance of the pose located, left tangent, for sigmas of 2^level px.
  [[nodiscard]] const Matrix6d& covariance() const { return seen_.covariance; }
  /// Mean depth of the points found [map unit]; nothing without any.
  [[nodiscard]] std::optional<double> mean_depth();
  /// The depth within which a tenth of the points searched lies, found or not [map unit]; nothing without
  /// any. Far lights have no part in it, even where they are all that is found.
  [[nodiscard]] std::optional<double> near_depth();
  /// The points searched; found are those that agree with the pose, none where there is none.
  [[nodiscard]] const std::vector<VisiblePoint>& points() const { return seen_.points; }

 private:
  /// The result of one look at a frame.
  struct Seen {
    std::vector<VisiblePoint> points;
    int attempted = 0;
    int hidden = 0;
    int found = 0;
    double rms = 0;
    std::optional<SE3> camera_from_map;
    Matrix6d covariance = Matrix6d::Identity();
    bool used_coarse = false;
  };

  void collect_depths();
  void look(const FrameImages& frame, const SE3& start, const SearchEffort& effort, StageProbe* probe);
  [[nodiscard]] std::optional<SE3> coarse_stage(const FrameImages& frame, const SE3& start,
                                                const SearchEffort& effort, StageProbe* probe);
  [[nodiscard]] std::optional<SE3> fine_stage(const FrameImages& frame, const SE3& start,
                                              const SearchEffort& effort, float radius, StageProbe* probe);
  void search_missing(const FrameImages& frame, const SearchReach& reach, StageProbe* probe);
  [[nodiscard]] bool is_as_expected(const SearchEffort& effort) const;
  void forget_found();
  void mark_hidden();
  [[nodiscard]] std::optional<SE3> solve(const SE3& start, double max_squared_cutoff, StageProbe* probe);

  CameraPtr camera_;
  PoseFinderOptions options_;
  float good_quality_;
  float lost_quality_;
  PointSearch search_;
  Seen seen_;   ///< at the latest locate()
  Seen other_;  ///< its other look, or an older one
  DepthOrder order_;
  std::vector<PointObservation> observations_;
  std::vector<float> depths_;
  std::vector<size_t> observed_;  ///< index into seen_.points of each observation
  PoseWorkspace workspace_;
  PoseEstimate estimate_;  ///< from them
};

}  // namespace cairn
