// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>

#include "server/relocalization/image_search.h"
#include "server/relocalization/relocalizer.h"

/// Whether a place that is confirmed by itself is believed, given all others that look like it.
namespace cairn {

/// A keyframe that may show the place of the query, and the result of its verification.
struct PlaceHypothesis {
  Ranked ranked;
  PlaceCandidate candidate;
  Confirmation said;
  double mean_depth = 0;        ///< [map unit] of the keyframe
  int hypotheses_of_place = 1;  ///< number of hypotheses of the same place, itself included
};

/// Number of points that both keyframes of one map measured, counted up to `enough`.
[[nodiscard]] size_t count_in_common(const IndexedKeyframe& a, const IndexedKeyframe& b,
                                     size_t enough = std::numeric_limits<size_t>::max());

/// Whether a keyframe of a map is of the place of a hypothesis: both measured `in_common` points
/// (RelocOptions::in_common).
[[nodiscard]] bool is_of_place(const IndexedKeyframe& keyframe, const MapId& map,
                               const PlaceHypothesis& hypothesis, size_t in_common);

/// Says why a place that is confirmed by itself is not believed, given all hypotheses, itself included;
/// nothing if it is believed.
[[nodiscard]] std::optional<std::string> find_why_refused(const RelocOptions& options,
                                                          const PlaceHypothesis& judged,
                                                          std::span<const PlaceHypothesis> hypotheses);

}  // namespace cairn
