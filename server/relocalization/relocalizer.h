// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "common/base/option_list.h"
#include "common/geometry/camera.h"
#include "common/image/place.h"
#include "common/map/map_set.h"
#include "common/map/relocalization_answer.h"
#include "server/relocalization/confirm.h"
#include "server/relocalization/image_search.h"
#include "server/relocalization/map_agreement.h"
#include "server/relocalization/place_index.h"
#include "server/relocalization/votes.h"

/// The relocalizer says in which map an image was taken, where, and how surely. It is pure and re-entrant:
/// queries run on any threads at the same time.
namespace cairn {

/// How keyframes are ranked and answers made.
enum class RelocMethod : uint8_t {
  kPaper = 0,     ///< Castle et al. 2008: the one nearest tiny image, turned by ESM; nothing is confirmed
  kImproved = 1,  ///< tiny images normalized for gain and words vote, geometry confirms
};

/// The relocalizer's options. DECISION.md says what sets the limits of the decision; the other options bound
/// the work of an answer, and those without a reason are chosen, not measured. Trials are run-look-alikes and
/// run-reloc (tests/bench/HISTORY.md).
struct RelocOptions {
  RelocMethod method = RelocMethod::kImproved;
  /// Number of keyframes, the most similar by their tiny images, that are prefiltered and looked at closer
  /// before the words vote.
  int by_image_alone = 2;
  /// Number of keyframes that a search prefilters by images and words, `by_image_alone` included. Geometry
  /// then examines first those of which the prefilter sees most. An answer names no more candidates than
  /// this.
  int shortlist = 16;
  /// How the tiny images are searched. With kScan the answer is the same whenever and wherever these maps are
  /// asked.
  ImageSearch search = ImageSearch::kForest;
  /// Number of images up to which all are scanned; with more a forest is planted, which finds most of the
  /// nearest sooner (cairn-index-bench).
  size_t most_scanned = 40'000;
  ForestOptions forest;
  ConfirmOptions confirm;
  /// Least share of the corners found at a confirmed place that no rival explains as something else; with
  /// less the place is refused. Rivals are keyframes of maps of which none is confirmed, and of its own map
  /// where they explain corners otherwise.
  double least_peculiar = 0.25;
  /// Least ratio of the corners that a confirmed place explains to those that any one rival does; with less
  /// it is refused.
  double least_margin = 1.25;
  /// A place is refused if at least so many keyframes show it in part otherwise for each one that confirms
  /// it.
  int outvoted_by = 3;
  /// [mean depths plus rad] Two poses in one map contradict each other if they are farther apart
  /// (separation()).
  double same_pose = kSamePose;
  /// Number of points that two keyframes of a map have to measure in common to be of one place.
  uint64_t in_common = 5;
  /// Number of keyframes in each of the two rankings, by images and by words, that are fused. Where images or
  /// words are led astray (other light) the place is far down in both, yet at a like rank.
  uint64_t fused = 128;
  /// Constant of reciprocal rank fusion, with the value of Cormack et al., SIGIR 2009.
  float fusion_damping = 60;
  /// Number of poses that a search looks for; looking for one is most of what a closer look costs. By trials:
  /// with 8 or 10 no more answers are right.
  uint64_t most_poses = 6;
  /// Number of further poses that a search looks for among the rivals of a place that it believes.
  uint64_t more_for_rivals = 3;
  /// Number of poses that a search looks for at its end, to find a better pose of a place that it believes.
  /// By trials: without them poses are farther off.
  uint64_t more_for_pose = 2;
  /// Image similarity of a believed place from which on no better pose is looked for.
  double sure_similarity = 0.65;
  /// Number of keyframes of a confirmed place that are examined, those included that the prefilter ruled out.
  /// After them other places have their turn, which may look as much like it.
  int hypotheses_of_place = 3;
  /// Number of neighbours that are prefiltered for each lead where nothing is confirmed. A lead is a keyframe
  /// whose matches support each other while too few agree on a pose.
  uint64_t neighbours_of_lead = 4;
  /// Number of neighbours that are prefiltered for all leads together.
  uint64_t hypotheses_of_leads = 4;
  /// Number of nearest images by which maps are selected: a query's words vote only for keyframes of the maps
  /// that these images belong to.
  uint64_t images_near = kImagesNear;
  VoteOptions votes;
  OverlapOptions overlap;
};

/// Lists the options that an operator may set: all but the method and the search, which are choices of a run.
[[nodiscard]] OptionList list_options(RelocOptions* options);

/// Which maps a query is about.
struct SearchScope {
  /// Maps that may be looked at. No other map is searched, named in the answer, or a rival of a place in
  /// these.
  MapSet maps = MapSet::all();
  /// Maps among `maps` that are searched before the others, which follow unless a place is clear; empty: all
  /// are searched at once. The paper's method, which has one answer and nothing that confirms it, ignores
  /// this.
  std::vector<MapId> first = {};
};

/// Answers where in the maps of `index` an image was taken, with the most likely candidate first.
/// PlaceCandidate::score is the mean squared difference of the tiny images (kPaper) or their correlation, 1 =
/// alike (kImproved).
[[nodiscard]] RelocalizationAnswer relocalize(const PlaceIndex& index, const Camera& camera,
                                              const PlaceView& view, const RelocOptions& options,
                                              const SearchScope& scope = {});

}  // namespace cairn
