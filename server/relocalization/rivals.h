// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>

#include "server/relocalization/picture_search.h"
#include "server/relocalization/relocalizer.h"

/// Whether a place that looks right by itself is believed, given all else that looks like it.
namespace cairn {

/// A keyframe that was asked about, and what geometry says of it.
struct Tried {
  Ranked ranked;
  PlaceCandidate candidate;
  Confirmation said;
  double mean_depth = 0;   ///< of the keyframe
  int tries_of_place = 1;  ///< keyframes tried that are of its place
};

/// Keyframes of a map that measured fewer points in common are of different places.
constexpr size_t kInCommon = 5;

/// Points that both keyframes of one map measured, counted up to `enough`.
[[nodiscard]] size_t count_in_common(const IndexedKeyframe& a, const IndexedKeyframe& b,
                                     size_t enough = std::numeric_limits<size_t>::max());

/// Whether a keyframe of a map is of the place of one that was tried.
[[nodiscard]] bool is_of_place(const IndexedKeyframe& keyframe, const MapId& map, const Tried& tried);

/// Why what looks right by itself is not believed, given all else that has been tried, itself included;
/// nothing: it is.
[[nodiscard]] std::optional<std::string> find_why_refused(const RelocOptions& options, const Tried& judged,
                                                          std::span<const Tried> tried);

}  // namespace cairn
