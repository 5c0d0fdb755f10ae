// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "server/relocalization/map_agreement.h"
#include "server/relocalization/relocalizer.h"

/// Maps that show the same place, detected from keyframes of the one whose images are confirmed in the
/// other. Pure.
namespace cairn {

/// Two maps: `one` < `other`.
struct MapPair {
  MapId one;
  MapId other;
  auto operator<=>(const MapPair&) const = default;
};
[[nodiscard]] inline MapPair pair_of(const MapId& a, const MapId& b) {
  return a < b ? MapPair{a, b} : MapPair{b, a};
}

/// What two maps have in common, as the newest keyframes tell that are in both.
struct Overlap {
  MapPair maps;
  size_t of_one = 0;  ///< keyframes of the one that show the other, all by one similarity
  size_t of_other = 0;
};

/// Where an image was taken in each map of the index that has its place: the best confirmed candidate of
/// each, of a handful of maps at most. As long as a query for each map that has it, and one more.
[[nodiscard]] std::vector<PlaceCandidate> find_in_each_map(PlaceIndex index, const Camera& camera,
                                                           const PlaceView& view,
                                                           const RelocOptions& options);

/// Gathers which keyframes of maps have been asked about in other maps, and with what answer.
///
/// One keyframe in another map may be a look-alike, and its neighbours in the map, which show the same, may
/// be taken in by the same. So an overlap is at least OverlapOptions::least_keyframes keyframes whose poses
/// agree on one similarity between the two maps, and no fewer than those that should show the other map by
/// that similarity, as they stood next to a keyframe of it, and are not known there nor anywhere: a place is
/// recognized from about where it was mapped, all but always; a place like it from here and there.
///
/// One thread at a time. Takes some 100 bytes a keyframe.
class OverlapDetector {
 public:
  explicit OverlapDetector(const OverlapOptions& options) : options_(options) {}

  /// A map is searched as it is in `map` from here on.
  void note_searched(const IndexedMap& map);
  /// When a query is put, before its index is taken: what is searched by then, it is about.
  [[nodiscard]] uint64_t now() { return ++clock_; }
  /// A keyframe of a map has been asked about at `time` in all others of `index`: where it is `found`, one
  /// candidate a map. The overlaps of its map with these, if there are any. Maps that are not searched any
  /// more count for nothing.
  [[nodiscard]] std::vector<Overlap> note_answer(const MapId& map, KeyframeId keyframe, uint64_t time,
                                                 std::span<const PlaceCandidate> found,
                                                 const PlaceIndex& index);
  void remove(const MapId& map);

 private:
  /// What is known of a keyframe. Times are counted, not measured.
  struct Entry {
    uint64_t searched_since = 0;
    uint64_t asked_at = 0;  ///< 0: has not been
    bool is_found = false;  ///< in any other map
  };
  using Entries = std::map<KeyframeId, Entry>;
  /// A keyframe that another map shows.
  struct Shown {
    bool is_of_one = false;  ///< of MapPair::one
    KeyframeId keyframe;
    KeyframeId other;       ///< of the other map, near which it was found
    SE3 camera_from_other;  ///< `keyframe`'s from the camera of `other`
    uint64_t asked_at = 0;
  };

  [[nodiscard]] std::optional<Overlap> judge(const MapPair& pair, const PlaceIndex& index) const;
  /// Keyframes of `asked` that should show the other map, were asked about at `since` or later, and do not.
  /// `other_from_asked`: the similarity.
  [[nodiscard]] size_t count_missing(const IndexedMap& asked, const IndexedMap& other,
                                     const Similarity3& other_from_asked, uint64_t since) const;

  OverlapOptions options_;
  uint64_t clock_ = 0;
  std::map<MapId, Entries> keyframes_;
  std::map<MapPair, std::vector<Shown>> shown_;
};

}  // namespace cairn
