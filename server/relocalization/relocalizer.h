// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/camera.h"
#include "common/image/place.h"
#include "common/map/map_set.h"
#include "common/map/relocalization_answer.h"
#include "server/relocalization/confirm.h"
#include "server/relocalization/image_search.h"
#include "server/relocalization/place_index.h"

/// Which map, where, and how sure. Pure and re-entrant: queries run on any threads at the
/// same time.
namespace cairn {

/// How keyframes are ranked and answers made.
enum class RelocMethod : uint8_t {
  kPaper = 0,     ///< Castle et al. 2008: the one nearest tiny image, turned by ESM; nothing is confirmed
  kImproved = 1,  ///< tiny images normalized for gain and words vote, geometry confirms
};

struct RelocOptions {
  RelocMethod method = RelocMethod::kImproved;
  /// Keyframes that are prefiltered before the words are asked: the most similar by their tiny images.
  int by_image_alone = 2;
  /// Keyframes that are prefiltered by images and words, those included; then, where nothing is confirmed,
  /// four neighbours of those that are half known. Geometry is asked about those of which most is seen.
  int shortlist = 16;
  /// kScan: the answer is the same whenever and wherever these maps are asked.
  ImageSearch search = ImageSearch::kForest;
  /// Images that are scanned before a forest is planted.
  size_t most_scanned = kMostScanned;
  ConfirmOptions confirm;
  /// What a place that is confirmed must have before its rivals, which are places of other maps and others of
  /// its own: its share of the corners found that none of them explains as something else,
  double least_peculiar = 0.25;
  /// and the corners that it explains, over those that any of them does.
  double least_margin = 1.25;
};

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
                                              const PlaceView& view, const RelocOptions& options = {},
                                              const SearchScope& scope = {});

}  // namespace cairn
