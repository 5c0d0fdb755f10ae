// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/option_list.h"
#include "common/map/limits.h"
#include "common/map/snapshot.h"

/// The options of the map maker and of its parts. Those of the parts stand here and not beside them, since
/// whoever makes a map needs the options and not the parts.
namespace cairn {

/// Who minimizes in bundle adjustment: our own solver, or Ceres, several times slower, as an independent
/// check (README.md). Global adjustments that calibrate cameras are always by our own.
enum class Adjuster : uint8_t { kOwn, kCeres };

/// Options of the search for a corner of one keyframe in another, along the line that its ray draws there
/// (epipolar_search).
struct EpipolarOptions {
  double near_margin = 0.6;  ///< nearest depth searched, over the 5th percentile of the keyframe's depths
  double far_margin = 1.8;   ///< farthest depth searched, over the 95th percentile
  int line_distance = 2;     ///< [level px] reach of the search on either side of the line
  /// [source-level px] Length of a piece of the line, which shares one warp and counts as straight.
  double segment_length = 24;
  int max_segments = 16;  ///< most pieces of a line; longer pieces are searched where more would be needed
  /// A level's box sums are made once one window for every so many of its pixels has been compared: more
  /// windows would cost more without sums than the sums do.
  int pixels_per_window = 4;
  /// [sigma^2] Largest squared residual of a new point in each of its two views.
  double max_squared_residual = 1.0;
  /// [level px] A place on the line that resembles the patch is a rival of the best one if it lies farther
  /// away. Refinement moves the best one no farther.
  float unique_distance = 3.0F;
  float unique_ratio = 0.7F;  ///< largest ZMSSD of the best match, over that of its best rival
};

/// Options of making points that two keyframes show (new_points; PTAM 2007, 6.2).
struct TwoViewPointOptions {
  int partners = 2;  ///< keyframes in which each candidate is searched, until one has it
  /// Keyframes beside the partners in which a new point is looked for, as in the other partners, to confirm
  /// it.
  int confirming_keyframes = 3;
  /// [rad] Least parallax of a new point, 1 degree: with less its depth from two views is noise (0.3 px at f
  /// 525 is 3 % of it).
  double min_parallax = 0.0175;
  /// [rad] Parallax from which on more does not make a partner better, and patches begin to differ.
  double good_parallax = 0.07;
  /// [rad] Parallax from which on a partner is worse: patches and occlusions differ too much.
  double wide_parallax = 0.25;
  /// [level px] Least distance of a candidate from a known measurement (PTAM r114).
  double known_distance = 10;
  double new_distance = 6;  ///< [level px] least distance between new points of one level
  /// [level px] Radius around its projection within which a confirming keyframe must show a new point.
  float confirm_radius = 3.0F;
  /// Least cosine between the directions from a new point to its source and to a confirming keyframe: a more
  /// oblique view proves nothing by not showing it.
  double confirm_cosine = 0.9;
  uint64_t overlap_samples = 60;      ///< points of the keyframe by which partners are ranked
  uint64_t candidates_per_poll = 64;  ///< candidates that are searched between two calls of should_yield
  /// Least strength of corners that may become points. It is weaker than the 2008 limits (barrier 10, 70),
  /// since in a compressed, slightly blurred image those leave a thin map, and alignment tells a weak patch
  /// from a useless one.
  int corner_barrier = 6;        ///< [grey levels] of FAST's score
  float corner_texture = 20.0F;  ///< Shi-Tomasi's measure
  /// [search-level px] Least distance of a new point's projection from the edge of a confirming keyframe's
  /// image.
  double image_border = 8;
  EpipolarOptions epipolar;
};

/// Options of making points of candidates, which a tracker has followed until it knew their depth
/// (candidate_points).
struct CandidatePointOptions {
  uint64_t partners = 4;  ///< keyframes in which a candidate is looked for
  /// Half the length of the line that is searched, in sigmas of the candidate's inverse depth.
  double sigmas = 3;
  /// Least inverse depth that is searched, as a share of the candidate's: the line ends before infinity.
  double least_share = 0.05;
  /// Largest sigma over depth with which a candidate becomes a point: 0.3 px of level 1 at a parallax of one
  /// degree and f 525, as of points from two views.
  double known_depth = 0.06;
  double measured_sigma = 0.3;  ///< [search-level px] standard deviation of where a candidate is found
  /// [search-level px^2] Largest squared distance of a find from where the depth that it corrects puts it.
  double max_squared_residual = 1.0;
  /// [level px] Least distance of a candidate from a measured point of the map, new ones included.
  float known_distance = 10;
  /// Least cosine between the directions from a candidate to its keyframe and to a partner: a more oblique
  /// view says nothing.
  double seen_cosine = 0.9;
  double image_border = 8;  ///< [search-level px] least distance of its projection from the image's edge
};

/// Options of finding known points in keyframes that do not measure them yet (refind).
struct RefindOptions {
  float radius = 4.0F;  ///< [search-level px] of the search around the projection (PTAM r114)
  /// Least cosine between the directions from a point to its source keyframe and to another (45 degrees):
  /// beyond, the patch looks different.
  double visible_cosine = 0.7;
  double image_border = 6;  ///< [search-level px] least distance of the projection from the image's edge
  /// Number of pairs of point and keyframe that are searched between two calls of should_yield.
  int per_poll = 200;
};

/// Options of judging a frame that may become a keyframe (integrate).
struct IntegrationOptions {
  /// Least number of measurements that agree with the pose and that the frame's own image bears out.
  uint64_t min_measurements = 20;
  /// Least cosine between the optical axes of keyframes that look the same way (26 degrees).
  double same_direction = 0.9;
  /// Share of the spacing that a keyframe must keep from every other, even if it shows new area or looks
  /// another way.
  double new_area_distance = 0.3;
  /// A frame shows new area if it has fewer good measurements than this share of its reference keyframe's
  /// number.
  double few_known = 0.6;
  int area_level = 1;  ///< pyramid level whose corners tell new area (KnownArea), the same as the tracker's
  /// [search-level px] Radius within which points of the map are looked for in a chained frame: a step of a
  /// chain is off by less.
  float chained_radius = 8;
  /// Least share of the points expected in a chained frame that must agree with its pose, as in a good frame
  /// of the tracker.
  double chained_share = 0.3;
  /// [search-level px] Farthest that refinement in the keyframe's image may move a measurement of the
  /// tracker.
  float max_refinement = 1.5F;
  /// Bounds of baseline over the first mean depth, by which keyframes are spaced (keyframe_spacing()). A
  /// start at very little or very much parallax would otherwise make far too many keyframes, or too few.
  double least_spacing = 0.04;
  double most_spacing = 0.12;
};

/// Options of the two-view start (seed; PTAM 2007, 6.1).
struct StartOptions {
  uint64_t min_points = 30;  ///< least number of points with which a map begins
  /// [sigma] Largest rms of the residuals of the adjusted pair: with more the two-view geometry was wrong.
  double max_rms = 2.0;
  float trail_shift = 2.0F;      ///< [px] farthest that refinement may move the end of a trail
  double plane_distance = 0.03;  ///< [mean depths] farthest that a point of the dominant plane lies from it
  int plane_trials = 200;        ///< samples drawn to find that plane
  /// Share of the least median parallax of a map (kLeastMapParallax) that the re-measured trails must have.
  /// The tracker asked its own matches for as much or more, by their noise; re-measured ones differ a little,
  /// and a bare pass there should not fail here.
  double parallax_tolerance = 0.8;
  /// Where the pair has little parallax, the share of its median that a further point needs.
  double share_of_parallax = 0.5;
};

/// Options of the upkeep of a map as it grows: removal of points and keyframes (upkeep).
struct UpkeepOptions {
  /// Number of searches after which a point is judged; 1 for a point that only one keyframe shows.
  int min_attempts = 6;
  double min_found_fraction = 0.2;  ///< share of these that must have found it; a point with less is removed
  /// Number of other keyframes that must show a point at the same or a finer level for a keyframe to be
  /// dispensable for it.
  int redundant_observers = 3;
  /// Share of a keyframe's points for which it must be dispensable to be removed as redundant (Mur-Artal et
  /// al., T-RO 2015).
  double redundant_fraction = 0.9;
  /// Number of newest keyframes that are never redundant: they are still being integrated, or are the
  /// reference of offers in flight.
  uint64_t newest_kept = 5;
};

/// Options of bundle adjustment (adjustment), beside those of the local one in MapMakerOptions.
struct AdjustmentOptions {
  /// A local adjustment ends with an iteration that lowers the cost by a smaller share than this.
  double local_tolerance = 1e-4;
  int global_iterations = 20;      ///< most iterations of a global adjustment
  double global_tolerance = 1e-6;  ///< as `local_tolerance`, of a global adjustment
  int start_rounds = 3;            ///< rounds of an adjustment at the start, each with a cut-off of its own
};

/// Options of self-calibration: of cameras that are calibrated in a map (map_camera, adjustment). Sigmas are
/// those of Intrinsics.
struct SelfCalibrationOptions {
  /// Largest sigmas with which a camera is known, and frozen: the focal length within 2.5 % with 95 %
  /// probability.
  double known_focal_sigma = 0.0125;
  double known_k1_sigma = 0.1;
  /// [ln of the focal length] Farthest that successive estimates may lie from the first of them and agree: a
  /// slow drift is no agreement. What was measured under a camera that is off agrees with it, and it takes
  /// many keyframes to draw the estimate away.
  double agreement = 0.01;
  /// Number of successive estimates that must agree with the one before them for a camera to be known.
  int enough_agreements = 3;
  /// Number of live keyframes that a camera needs to become known: the spread of fewer says little.
  uint64_t fewest_keyframes = 12;
  /// As `fewest_keyframes`, for a camera whose prior sigma was no larger than `known_focal_sigma`: it tells
  /// nothing of the keyframes.
  uint64_t fewest_of_believed = 20;
  /// Number of keyframes ever made of a camera from which on it counts as one that cannot be known if it is
  /// not: more of the same will not tell.
  uint64_t many_keyframes = 40;
  /// Such a camera is judged again once its keyframes have grown by one for every so many.
  uint64_t one_more_to = 4;
  /// [ln of the focal length] Change of a camera from which on patches are aimed anew and all points are
  /// searched again: some px where the image ends.
  double felt_move = 0.02;
  /// Number of cameras that one adjustment judges; each of them takes several adjustments.
  uint64_t most_judged = 2;
  uint64_t most_free = 4;  ///< cameras that an adjustment moves: each is a border of the reduced system
  /// Number of live keyframes from which on a camera is adjusted: two views hardly tell a focal length.
  uint64_t fewest_to_move = 3;
  /// Number of keyframes ever made of a camera from which on k1 is adjusted freely. With fewer views, most of
  /// all of a plane, distortion makes up for a wrong focal length, so k1 is held by the sigma below, which is
  /// less than 0.1 px in the corners of a view of 60 degrees.
  uint64_t fewest_for_distortion = 6;
  double held_k1_sigma = 1e-3;
  /// Factor on the squared cut-off of the robust cost up to which a residual of a camera that is not known
  /// yet leaves its measurement in the map.
  double forbearance = 9;
};

/// Options that say which changes of a map are worth being sent (snapshot_builder, map_camera).
struct PublicationOptions {
  /// [px] Least move of a point, as seen from its source keyframe, or of a keyframe or camera that is sent
  /// again.
  double visible_move = 0.2;
  /// Least change that is sent of the mean direction from which a point is seen [rad, roughly], or of its
  /// viewing cone's cosine.
  float visible_turn = 0.05F;
  float visible_distance = 0.15F;  ///< least relative change that is sent of the range of viewing distances
  /// A camera is sent again if a sigma is below this share of the one published before: it is known notably
  /// better.
  double better_sigma = 0.7;
};

struct MapMakerOptions {
  Adjuster adjuster = Adjuster::kOwn;
  double baseline = 0.1;  ///< [m] distance of the first two keyframes: the map's scale (PTAM r114)
  /// Least distance of a keyframe from others that look the same way, over its mean depth, in units of
  /// baseline / first mean depth (PTAM r114).
  double min_keyframe_distance = 1.0;
  /// Most new points that are made for a keyframe; at the start, half as many at each pyramid level.
  int max_points_per_keyframe = 1000;
  /// Number of keyframes, beside the newest, that move in a local adjustment: those that share most points
  /// with it (PTAM r114).
  int local_keyframes = 4;
  int local_iterations = 10;       ///< most iterations of a local adjustment
  size_t max_points = kMaxPoints;  ///< most points ever made in a map: removed ones keep their slot
  uint64_t seed = 1;               ///< of the search for the dominant plane
  StartOptions start = {};
  IntegrationOptions integration = {};
  TwoViewPointOptions new_points = {};
  CandidatePointOptions candidates = {};
  RefindOptions refind = {};
  UpkeepOptions upkeep = {};
  AdjustmentOptions adjustment = {};
  SelfCalibrationOptions self_calibration = {};
  PublicationOptions publication = {};
};

/// Lists the options that an operator may set: all but the adjuster and the seed, which are choices of a run.
[[nodiscard]] OptionList list_options(MapMakerOptions* options);

}  // namespace cairn
