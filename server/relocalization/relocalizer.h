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

/// Which map, where, and how sure. Pure and re-entrant: queries run on any threads at the
/// same time.
namespace cairn {

/// How keyframes are ranked and answers made.
enum class RelocMethod : uint8_t {
  kPaper = 0,     ///< Castle et al. 2008: the one nearest tiny image, turned by ESM; nothing is confirmed
  kImproved = 1,  ///< tiny images normalized for gain and words vote, geometry confirms
};

/// What sets the limits of the decision is in DECISION.md; the others bound the work of an answer. Those
/// without a reason are chosen, not measured. Trials are run-look-alikes and run-reloc
/// (tests/bench/HISTORY.md).
struct RelocOptions {
  RelocMethod method = RelocMethod::kImproved;
  /// Keyframes that are prefiltered before the words are asked: the most similar by their tiny images.
  int by_image_alone = 2;
  /// Keyframes that are prefiltered by images and words, those included; then, where nothing is confirmed,
  /// some neighbours of those that are half known. Geometry is asked about those of which most is seen.
  int shortlist = 16;
  /// kScan: the answer is the same whenever and wherever these maps are asked.
  ImageSearch search = ImageSearch::kForest;
  /// Images that are scanned before a forest is planted, which finds more of them sooner (cairn-index-bench).
  size_t most_scanned = 40'000;
  ForestOptions forest;
  ConfirmOptions confirm;
  /// What a place that is confirmed must have before its rivals, which are places of other maps and others of
  /// its own: its share of the corners found that none of them explains as something else,
  double least_peculiar = 0.25;
  /// and the corners that it explains, over those that any of them does.
  double least_margin = 1.25;
  /// Keyframes that show this place in part otherwise, over those that confirm it: so many refuse it.
  int outvoted_by = 3;
  /// [mean depths plus rad] poses in one map that are farther apart contradict each other.
  double same_pose = kSamePose;
  /// Points; keyframes of a map that measured fewer in common are of different places.
  uint64_t in_common = 5;
  /// Length of the two orders of merit that are fused. Where images or words are led astray (other light) the
  /// place is far down in both, yet at a like rank.
  uint64_t fused = 128;
  float fusion_damping = 60;  ///< of reciprocal rank fusion: Cormack et al., SIGIR 2009, with their constant
  /// Poses: looking for one is most of what a closer look costs. By trials: with 8 or 10 no more answers are
  /// right, and without the last two poses are farther off. So many are looked for in a search, so many more
  /// where a place is believed, of its rivals, and then so many for the best pose there, unless the image
  /// looks so similar from one of its keyframes.
  uint64_t most_poses = 6;
  uint64_t more_for_rivals = 3;
  uint64_t more_for_pose = 2;
  double sure_similarity = 0.65;
  /// So many keyframes of a place that has been confirmed are examined, those included that the prefilter
  /// ruled out; then others are, which may look as much like it.
  int hypotheses_of_place = 3;
  /// Where nothing is confirmed, so many neighbours of each keyframe that is half known are prefiltered, and
  /// so many in all.
  uint64_t neighbours_of_lead = 4;
  uint64_t hypotheses_of_leads = 4;
  /// Images that a query looks at: its words vote for keyframes of the maps of these.
  uint64_t images_near = kImagesNear;
  VoteOptions votes;
  OverlapOptions overlap;
};

/// What an operator may set: all that is no choice of a run, whose are the method and the search.
[[nodiscard]] OptionList list_options(RelocOptions* options);

/// Which maps a query is about.
struct SearchScope {
  /// Those that may be looked at. No others are searched, named in the answer, or rivals of what is.
  MapSet maps = MapSet::all();
  /// Of these, the ones that are searched before the others, which follow unless a place is clear; empty: all
  /// at once. The paper's method, which has one answer and nothing that confirms it, goes by `maps` alone.
  std::vector<MapId> first = {};
};

/// PlaceCandidate::score is the mean squared difference of the tiny images (kPaper) or their correlation, 1 =
/// alike (kImproved).
[[nodiscard]] RelocalizationAnswer relocalize(const PlaceIndex& index, const Camera& camera,
                                              const PlaceView& view, const RelocOptions& options,
                                              const SearchScope& scope = {});

}  // namespace cairn
