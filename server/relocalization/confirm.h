// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "server/relocalization/appearance.h"
#include "server/relocalization/certainty.h"
#include "server/relocalization/gravity.h"
#include "server/relocalization/image_cells.h"
#include "server/relocalization/match.h"
#include "server/relocalization/refine.h"

namespace cairn {

/// What sets the limits of the decision is in DECISION.md. Trials are run-look-alikes and run-reloc
/// (tests/bench/HISTORY.md).
struct ConfirmOptions {
  MatchOptions match;
  AppearanceOptions appearance;
  RefineOptions refine;
  SettleOptions settle;
  GravityOptions gravity;
  int agreeing_in_cell = 2;       ///< corners in a cell that counts as agreeing: one may agree by chance
  double ransac_threshold = 2.5;  ///< [px of the corner's level]
  /// Of a keyframe's points, one of so many tells whether a pose is worth refining. By trials: of the poses
  /// that are refused 62 % end there, of the right ones 0.12 %.
  uint64_t rough_step = 3;
  int min_supported = 6;  ///< matches that moved as their neighbours did, without which no pose is tried
  int ransac_iterations = 150;  ///< triples of matches drawn; by trials: with 300 the time grows
  int min_agreeing = 8;         ///< of all matches by descriptors alone, with the pose: it is refined
  int enough_agreeing = 12;     ///< of these: with fewer the pose is believed `by_few` alone
  int many_agreeing = 16;       ///< up to which `by_image` asks for more evidence, as `by_few` does
  int min_inliers = 30;         ///< of the refined pose
  int min_cells = 5;            ///< of kImageCells of the image, in which inliers lie
  /// What a hypothesis needs to be accepted. Sources that know nothing of each other have to speak for it:
  /// how similar the image is (appearance.h), what all of them say together (evidence()), inliers: their
  /// share of what could match around the pose (GuidedMatches::met), and of the points expected, and how much
  /// of the image corners that agree lie in; and in how many cells of it what is there speaks against the
  /// place. Any of these ways is enough.
  struct Acceptance {
    double similarity = 0;
    double evidence = 0;
    double of_met = 0;
    double of_expected = 0;
    int agreeing_cells = 0;
    int inconsistent_cells = kImageCells;  ///< at most
  };
  /// It looks the same, all over but for one cell.
  Acceptance by_image = {.similarity = 0.53, .evidence = 0.66, .of_met = 0.35, .inconsistent_cells = 1};
  /// Partly hidden: most of its points are seen.
  Acceptance by_points = {.similarity = 0.50, .evidence = 0.60, .of_met = 0.45, .of_expected = 0.36};
  /// A part has moved: the rest, in most of the image, agrees.
  Acceptance by_extent = {.similarity = 0.42, .of_met = 0.53, .agreeing_cells = 8};
  /// Few corners agree, as where much of the image is white: all else must speak clearly.
  Acceptance by_few = {.similarity = 0.53, .evidence = 0.75, .of_met = 0.45, .inconsistent_cells = 1};
  /// So many agreeing corners, and evidence of most right answers, which no look-alike has: no other keyframe
  /// is tried.
  int clear_agreeing = 25;
  double clear_evidence = 0.82;
  /// With the first pose, before it is refined: with less the place is another, unless corners agree
  /// `by_extent`.
  double least_evidence = 0.45;
  double least_similarity = 0.25;
  /// Of the depth: what position_sigma(), which is no less than the truth, may be. A pose that is farther off
  /// is wrong.
  double most_sigma = 0.03;
  uint64_t seed = 1;
};

/// A corner of a query, and what it shows if the place is this.
struct ExplainedCorner {
  size_t corner = 0;         ///< index into PlaceView::corners
  Eigen::Vector3d ray;       ///< unit, from the query's camera through the corner
  Eigen::Vector3d position;  ///< of the point that it shows, map frame
};

/// What geometry says of a keyframe as the place of a query.
struct Confirmation {
  bool confirmed = false;
  bool changed = false;  ///< confirmed by ConfirmOptions::by_extent alone: what is seen differs in part
  /// Of the refined pose; of the one from three matches, where that was refused or could not be refined;
  /// nothing: none was found with which ConfirmOptions::min_agreeing agree
  std::optional<SE3> camera_from_map;
  int matches = 0;          ///< by descriptors alone; of half of the corners where none of these is supported
  int supported = 0;        ///< of these, by their neighbours
  int agreeing = 0;         ///< of all, with the pose from three that are supported
  int found_otherwise = 0;  ///< of `supported`, not agreeing, at whose corners the refined pose finds points
  int inliers = 0;          ///< of the refined pose
  int expected = 0;         ///< points of the neighbourhood that project into the image
  int met = 0;              ///< matches of these that there could be (GuidedMatches)
  int occupied_cells = 0;   ///< of kImageCells, with an inlier in them
  int agreeing_cells = 0;   ///< of kImageCells, with ConfirmOptions::agreeing_in_cell or more of `agreeing`
  /// Appearance::local and order: by the refined pose, or else by the first, of some points of the keyframe
  double similarity = -1;
  double order = -1;
  int inconsistent_cells = 0;  ///< Appearance::inconsistent_cells
  std::vector<size_t> found;   ///< corners on which points lie by the refined pose: as many as `inliers`
  /// `supported`, and unless few agree and it is refused `found`, or those that are `agreeing` where there is
  /// no refined pose; ascending, each corner once
  std::vector<ExplainedCorner> explained;
  std::string reason;  ///< why it is not confirmed
};

/// 0..1: of the matches that moved as their neighbours did, the share that one pose brings together, or whose
/// corners it explains by other points: a key of a keyboard is taken for the next, and so are its neighbours.
/// In a place that only looks alike the same things stand, but not as they stand here: each of them moved as
/// a whole, and no pose fits them all.
[[nodiscard]] double unity(const Confirmation& said);

/// What the image and unity() say together, for a place like this one may be well off by any of them: a
/// mean, in which local brightness, which tells most, counts twice.
[[nodiscard]] double evidence(const Confirmation& said);

/// Corners against the keyframe's points, a pose from three that moved as their neighbours did and with which
/// most agree (P3P in RANSAC), then, if the image looks a little like it there, the points of that keyframe
/// and of others around the pose, and the pose from what is found. `keyframe`: index into those of the map;
/// `prefilter`: its result there. Deterministic.
[[nodiscard]] Confirmation confirm(const PlaceView& view, std::span<const CellList> cells,
                                   const CornerGrid& grid, const Camera& camera, const IndexedMap& map,
                                   size_t keyframe, const Prefilter& prefilter,
                                   const ConfirmOptions& options);

/// The pose of a confirmed place is looked for anew from around it (settle()), and judged again by what is
/// seen from there: it is no longer confirmed where that speaks against it, or leaves too open where the
/// camera is.
void confirm_settled(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                     const IndexedMap& map, size_t keyframe, const ConfirmOptions& options,
                     Confirmation* said);

}  // namespace cairn
