// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/option_list.h"
#include "common/map/limits.h"
#include "common/map/snapshot.h"

/// The map maker's options, those of its parts included. A part's stand here and not beside it, since whoever
/// makes a map needs them and not the part.
namespace cairn {

/// Who minimizes in bundle adjustment: our own solver, or Ceres, several times slower, as an independent
/// check (README.md).
enum class Adjuster : uint8_t { kOwn, kCeres };

/// Of a corner of one keyframe in another, along the line that its ray draws there (epipolar_search).
struct EpipolarOptions {
  double near_margin = 0.6;    ///< depths searched, relative to the keyframe's 5th percentile of depth
  double far_margin = 1.8;     ///< and to its 95th
  int line_distance = 2;       ///< [level px] searched on either side of the line
  double segment_length = 24;  ///< [source-level px] of the line that shares one warp and counts as straight
  int max_segments = 16;
  int pixels_per_window = 4;          ///< whose sums cost what one window costs more without them
  double max_squared_residual = 1.0;  ///< [sigma^2] of a new point in each of its two views
  float unique_distance = 3.0F;       ///< [level px] a rival is a corner farther away than this
  float unique_ratio = 0.7F;          ///< best ZMSSD over the best rival's
};

/// Of points that two keyframes show (new_points; PTAM 2007, 6.2).
struct TwoViewPointOptions {
  int partners = 2;              ///< keyframes searched for each candidate, until one has it
  int confirming_keyframes = 3;  ///< further keyframes that are asked to confirm a new point
  /// [rad] 1 degree: below, the depth from two views is noise (0.3 px at f 525 is 3 % of it).
  double min_parallax = 0.0175;
  double good_parallax = 0.07;    ///< [rad] from here on more does not help, and patches begin to differ
  double wide_parallax = 0.25;    ///< [rad] from here on patches and occlusions differ too much
  double known_distance = 10;     ///< [level px] of a candidate from a known measurement (PTAM r114)
  double new_distance = 6;        ///< [level px] between new points of one level
  float confirm_radius = 3.0F;    ///< [level px]
  double confirm_cosine = 0.9;    ///< a view more oblique against the source's proves nothing by not finding
  uint64_t overlap_samples = 60;  ///< points by which partners are ranked
  uint64_t candidates_per_poll = 64;  ///< candidates between two looks at who waits
  /// Of the corners that may become points: weaker than the 2008 limits (barrier 10, 70), since in a
  /// compressed, slightly blurred image those leave a thin map, and alignment tells a weak patch from a
  /// useless one.
  int corner_barrier = 6;        ///< [grey levels] of FAST's score
  float corner_texture = 20.0F;  ///< Shi-Tomasi's measure
  double image_border = 8;       ///< [search-level px] of a confirming view from the image's edge
  EpipolarOptions epipolar;
};

/// Of points of what a tracker has followed until it knew the depth (candidate_points).
struct CandidatePointOptions {
  uint64_t partners = 4;      ///< keyframes in which a candidate is looked for
  double sigmas = 3;          ///< of its inverse depth: the line that is searched
  double least_share = 0.05;  ///< of its inverse depth: the line ends before infinity
  /// Sigma over depth of a point that is known: 0.3 px of level 1 at a parallax of one degree and f 525, as
  /// of points from two views.
  double known_depth = 0.06;
  double measured_sigma = 0.3;        ///< [search-level px]
  double max_squared_residual = 1.0;  ///< [search-level px^2] across the line
  float known_distance = 10;          ///< [level px] from a point of the map, as of other new points
  double seen_cosine = 0.9;           ///< a more oblique view against the keyframe's says nothing
  double image_border = 8;            ///< [search-level px] of its projection from the image's edge
};

/// Of known points in keyframes that do not measure them yet (refind).
struct RefindOptions {
  float radius = 4.0F;          ///< [search-level px] (PTAM r114)
  double visible_cosine = 0.7;  ///< 45 degrees off the source's direction: beyond, the patch is another one
  double image_border = 6;      ///< [search-level px] of the projection from the image's edge
  int per_poll = 200;           ///< pairs between two looks at who waits
};

/// Of a frame that wants to become a keyframe (integrate).
struct IntegrationOptions {
  uint64_t min_measurements = 20;  ///< good ones
  /// Cosine between optical axes of keyframes that look the same way (26 degrees).
  double same_direction = 0.9;
  double new_area_distance = 0.3;  ///< of the spacing: what a keyframe that shows new area needs
  double few_known = 0.6;          ///< of the reference keyframe's measurements: fewer count as new area
  int area_level = 1;              ///< whose corners tell new area (KnownArea); as the tracker's own
  float chained_radius = 8;        ///< [search-level px] a step of a chain is off by less
  double chained_share = 0.3;      ///< of the points in sight: a good frame, as the tracker has it
  float max_refinement = 1.5F;     ///< [search-level px] from the tracker's measurement
  /// [baselines over the first mean depth] A start at very little or very much parallax would make far too
  /// many keyframes, or too few.
  double least_spacing = 0.04;
  double most_spacing = 0.12;
};

/// Of the two-view start (seed; PTAM 2007, 6.1).
struct StartOptions {
  uint64_t min_points = 30;      ///< a map begins with
  double max_rms = 2.0;          ///< [sigma] of the adjusted pair: above, the two-view geometry was wrong
  float trail_shift = 2.0F;      ///< [px] of a trail's end under refinement
  double plane_distance = 0.03;  ///< [mean depths] of a point of the dominant plane from it
  int plane_trials = 200;
  /// The tracker asked its own matches for as much parallax or more, by their noise; re-measured ones differ
  /// a little, and a bare pass there should not fail here.
  double parallax_tolerance = 0.8;
  double share_of_parallax = 0.5;  ///< of the median: what a further point needs of it
};

/// Of what keeps a map good as it grows (upkeep).
struct UpkeepOptions {
  int min_attempts = 6;             ///< before a point is judged
  double min_found_fraction = 0.2;  ///< of these
  int redundant_observers = 3;      ///< keyframes that show a point as well
  /// Of a keyframe's points, which is redundant then (Mur-Artal et al., T-RO 2015).
  double redundant_fraction = 0.9;
  uint64_t newest_kept = 5;  ///< keyframes: still being integrated, or the reference of offers in flight
};

/// Of bundle adjustment (adjustment), beside what MapMakerOptions says of the local one.
struct AdjustmentOptions {
  double local_tolerance = 1e-4;  ///< of the cost: an iteration that wins less is the last
  int global_iterations = 20;
  double global_tolerance = 1e-6;
  int start_rounds = 3;  ///< of an adjustment at the start, each with a cutoff of its own
};

/// Of cameras that are calibrated in a map (map_camera, adjustment). Sigmas are those of Intrinsics.
struct SelfCalibrationOptions {
  /// A camera is known, and frozen, with sigmas no larger: the focal length within 2.5 % with 95 %.
  double known_focal_sigma = 0.0125;
  double known_k1_sigma = 0.1;
  /// [ln of the focal length] of successive estimates, with the first of them: a slow drift is no agreement.
  /// What was measured under a camera that is off agrees with it, and it takes many keyframes to draw the
  /// estimate away.
  double agreement = 0.01;
  int enough_agreements = 3;       ///< for a camera to be known
  uint64_t fewest_keyframes = 12;  ///< whose spread says something
  /// Likewise where the sigma was small to begin with and tells nothing of them.
  uint64_t fewest_of_believed = 20;
  uint64_t many_keyframes = 40;  ///< what these have not told, more of the same will not
  uint64_t one_more_to = 4;      ///< beyond these: one new keyframe to so many is worth another look
  double felt_move = 0.02;       ///< [ln of the focal length] some px where the image ends
  uint64_t most_judged = 2;      ///< cameras by one adjustment: judging takes several adjustments each
  uint64_t most_free = 4;        ///< cameras that an adjustment moves: each is a border of the reduced system
  uint64_t fewest_to_move = 3;   ///< keyframes: two views hardly tell a focal length
  /// Keyframes ever made: over fewer views, most of all of a plane, distortion makes up for a wrong focal
  /// length, so k1 is held; by this sigma, which is less than 0.1 px in the corners of a view of 60 degrees.
  uint64_t fewest_for_distortion = 6;
  double held_k1_sigma = 1e-3;
  /// [of the squared cutoff] to which a measurement of a camera that is not known yet may be off and stay.
  double forbearance = 9;
};

/// Of what changes of a map are worth being sent (snapshot_builder, map_camera).
struct PublicationOptions {
  double visible_move = 0.2;  ///< [px] as seen from the source keyframe: what moves by less is not sent again
  /// [rad, roughly] of the mean viewing direction, and of its cone's cosine.
  float visible_turn = 0.05F;
  float visible_distance = 0.15F;  ///< relative change of the range of viewing distances
  double better_sigma = 0.7;       ///< of the one published before: a camera is known notably better
};

struct MapMakerOptions {
  Adjuster adjuster = Adjuster::kOwn;
  double baseline = 0.1;  ///< [m] distance of the first two keyframes: the map's scale (PTAM r114)
  /// In units of baseline / first mean depth, times mean depth (PTAM r114).
  double min_keyframe_distance = 1.0;
  int max_points_per_keyframe = 1000;  ///< new points made at most per keyframe
  /// Nearest keyframes that move in a local adjustment, beside the newest (PTAM r114).
  int local_keyframes = 4;
  int local_iterations = 10;       ///< of a local adjustment
  size_t max_points = kMaxPoints;  ///< ever made: removed points keep their slot
  uint64_t seed = 1;
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

/// What an operator may set: all that is no choice of a run, whose are the adjuster and the seed.
[[nodiscard]] OptionList list_options(MapMakerOptions* options);

}  // namespace cairn
