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

/// Options of the verification of a hypothesis. DECISION.md says what sets the limits of the decision. Trials
/// are run-look-alikes and run-reloc (tests/bench/HISTORY.md).
struct ConfirmOptions {
  MatchOptions match;
  AppearanceOptions appearance;
  RefineOptions refine;
  SettleOptions settle;
  GravityOptions gravity;
  /// Least number of agreeing corners in a cell that counts as agreeing: one may agree by chance.
  int agreeing_in_cell = 2;
  /// [px of the corner's level] Reprojection error up to which a match agrees with a pose.
  double ransac_threshold = 2.5;
  /// One of so many of a keyframe's points is compared with the image to tell whether a pose is worth
  /// refining. By trials: of the poses that are refused 62 % end there, of the right ones 0.12 %.
  uint64_t rough_step = 3;
  /// Least number of matches that moved as their neighbours did; with fewer no pose is looked for.
  int min_supported = 6;
  /// Number of triples of matches that RANSAC draws. By trials: with 300 the time grows.
  int ransac_iterations = 150;
  /// Least number of the matches by descriptors alone that must agree with the pose for it to be refined.
  int min_agreeing = 8;
  /// Number of agreeing matches below which a place is accepted `by_few` alone.
  int enough_agreeing = 12;
  /// Number of agreeing matches from which on `by_image` asks for no more than its own evidence; with fewer
  /// it asks for more, up to that of `by_few`.
  int many_agreeing = 16;
  int min_inliers = 30;  ///< least number of inliers of the refined pose
  int min_cells = 5;     ///< least number of cells of the image, of kImageCells, in which inliers lie
  /// What a hypothesis needs to be accepted in one of several ways, any of which is enough (DECISION.md, 4).
  /// All conditions of that way must hold. They come from sources that know nothing of each other.
  struct Acceptance {
    double similarity = 0;   ///< least image similarity (Appearance::local, -1 to 1)
    double evidence = 0;     ///< least evidence()
    double of_met = 0;       ///< least share of the possible matches (GuidedMatches::met) that are inliers
    double of_expected = 0;  ///< least share of the points expected in the image that are inliers
    int agreeing_cells = 0;  ///< least number of agreeing cells (ConfirmOptions::agreeing_in_cell)
    int inconsistent_cells = kImageCells;  ///< most cells in which the image speaks against the place
  };
  /// The place looks the same, all over but for one cell.
  Acceptance by_image = {.similarity = 0.53, .evidence = 0.66, .of_met = 0.35, .inconsistent_cells = 1};
  /// The place is partly hidden: most of its points are seen.
  Acceptance by_points = {.similarity = 0.50, .evidence = 0.60, .of_met = 0.45, .of_expected = 0.36};
  /// A part of the place has moved: the rest, in most of the image, agrees.
  Acceptance by_extent = {.similarity = 0.42, .of_met = 0.53, .agreeing_cells = 8};
  /// Few corners agree, as where much of the image is white: all other evidence must speak clearly.
  Acceptance by_few = {.similarity = 0.53, .evidence = 0.75, .of_met = 0.45, .inconsistent_cells = 1};
  /// Number of agreeing corners and evidence() from which on an accepted place is clear, so that no other
  /// keyframe is examined. Most right answers have as much, and no look-alike has.
  int clear_agreeing = 25;
  double clear_evidence = 0.82;
  /// Least evidence() and image similarity with which the first pose is refined at all. With less the place
  /// is another, unless as many cells agree as `by_extent` needs.
  double least_evidence = 0.45;
  double least_similarity = 0.25;
  /// [median depths] Largest standard deviation of the camera's position, position_sigma(), with which a
  /// place is accepted; it is no less than the true one. A pose that is farther off is wrong.
  double most_sigma = 0.03;
  uint64_t seed = 1;  ///< of RANSAC
};

/// A corner of a query, and the map point that it shows if the hypothesis is right.
struct ExplainedCorner {
  size_t corner = 0;         ///< index into PlaceView::corners
  Eigen::Vector3d ray;       ///< unit, from the query's camera through the corner
  Eigen::Vector3d position;  ///< of the point that it shows, map frame
};

/// The result of verifying a keyframe as the place of a query.
struct Confirmation {
  bool confirmed = false;
  bool changed = false;  ///< confirmed by ConfirmOptions::by_extent alone: what is seen differs in part
  /// The refined pose, or the first one where refinement was refused or failed. Nothing if no pose was found
  /// with which ConfirmOptions::min_agreeing matches agree, or if gravity forbids the first pose.
  std::optional<SE3> camera_from_map;
  /// Number of matches by descriptors alone; of half of the corners only, where none of these is supported.
  int matches = 0;
  int supported = 0;  ///< of `matches`, those that neighbours support
  /// Number of `matches` that agree with the first pose, which RANSAC finds from three supported ones and all
  /// `matches` refine.
  int agreeing = 0;
  /// Number of `supported` matches that do not agree, but at whose corners the refined pose finds other
  /// points.
  int found_otherwise = 0;
  int inliers = 0;         ///< of the refined pose
  int expected = 0;        ///< points of the neighbourhood that project into the image
  int met = 0;             ///< possible matches of these (GuidedMatches::met)
  int occupied_cells = 0;  ///< of kImageCells, with an inlier in them
  int agreeing_cells = 0;  ///< of kImageCells, with ConfirmOptions::agreeing_in_cell or more of `agreeing`
  /// Appearance::local and Appearance::order with the refined pose, or else with the first one, then at some
  /// of the keyframe's points; -1 if no pose was compared with the image.
  double similarity = -1;
  double order = -1;
  int inconsistent_cells = 0;  ///< Appearance::inconsistent_cells
  std::vector<size_t> found;   ///< corners on which points lie by the refined pose: as many as `inliers`
  /// Corners of the `supported` matches; unless few agree and the place is refused, also those `found`, or
  /// where there is no refined pose those that are `agreeing`. Ascending, each corner once. Empty if gravity
  /// forbids the first pose.
  std::vector<ExplainedCorner> explained;
  std::string reason;  ///< why it is not confirmed
};

/// Share, 0 to 1, of the supported matches that one pose brings together or whose corners it explains by
/// other points: a key of a keyboard is taken for the next, and so are its neighbours. In a place that only
/// looks alike the same things stand, but not as they stand here: each of them moved as a whole, and no pose
/// fits them all.
[[nodiscard]] double unity(const Confirmation& said);

/// Weighted mean of image similarity, grey order and unity(). Image similarity, which tells most, counts
/// twice. A place that only looks like the right one may do well by any single one of them.
[[nodiscard]] double evidence(const Confirmation& said);

/// Verifies a keyframe as the place of a query. The corners are matched with the keyframe's points; P3P in
/// RANSAC finds the pose from three supported matches with which most of these agree, and it is optimized
/// over all matches. If the image looks a little like the place from there, the pose is refined with the
/// points of this keyframe and of others around. `keyframe`: index into those of the map; `prefilter`: its
/// result there. Deterministic.
[[nodiscard]] Confirmation confirm(const PlaceView& view, std::span<const CellList> cells,
                                   const CornerGrid& grid, const Camera& camera, const IndexedMap& map,
                                   size_t keyframe, const Prefilter& prefilter,
                                   const ConfirmOptions& options);

/// Searches from around a confirmed pose for a better one (settle()) and judges the place again by what is
/// seen from there. `said` is no longer confirmed where that speaks against it, or leaves too open where the
/// camera is. Precondition: `said` has a pose.
void confirm_settled(const PlaceView& view, const CornerGrid& grid, const Camera& camera,
                     const IndexedMap& map, size_t keyframe, const ConfirmOptions& options,
                     Confirmation* said);

}  // namespace cairn
