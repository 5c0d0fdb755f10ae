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

/// Two maps that show one place, and how many of the newest keyframes found in both say so.
struct Overlap {
  MapPair maps;
  size_t of_one = 0;  ///< keyframes of the one that show the other, all by one similarity
  size_t of_other = 0;
};

/// Finds where an image was taken in each map of the index that has its place: the best confirmed candidate
/// of each, until OverlapOptions::most_maps maps have it or no other has. Takes at most as long as a query
/// for each map that has it, and one more.
[[nodiscard]] std::vector<PlaceCandidate> find_in_each_map(PlaceIndex index, const Camera& camera,
                                                           const PlaceView& view,
                                                           const RelocOptions& options);

/// Gathers which keyframes of maps have been searched for in other maps, and with what answer. One keyframe
/// in another map may be a look-alike, and so may its neighbours in the map, which show the same. So maps
/// overlap only if at least OverlapOptions::least_keyframes keyframes agree on one similarity, and no fewer
/// than those that are missing: that stand next to a keyframe of the other map by that similarity, and were
/// found in no map. One thread at a time. Takes some 100 bytes a keyframe.
class OverlapDetector {
 public:
  explicit OverlapDetector(const OverlapOptions& options) : options_(options) {}

  /// Notes that a map is searched as it is in `map` from here on.
  void note_searched(const IndexedMap& map);
  /// Time for note_answer(), a count. It is taken when a query is put, before its index is: the query is
  /// about all maps noted by note_searched() until then.
  [[nodiscard]] uint64_t now() { return ++clock_; }
  /// Notes that a keyframe of a map was searched for at `time` in all other maps of `index`, and where it was
  /// `found`, one candidate a map. Returns the overlaps of its map with these. Maps that are no longer
  /// searched count for nothing.
  [[nodiscard]] std::vector<Overlap> note_answer(const MapId& map, KeyframeId keyframe, uint64_t time,
                                                 std::span<const PlaceCandidate> found,
                                                 const PlaceIndex& index);
  void remove(const MapId& map);

 private:
  /// When a keyframe could be found by queries, and when it was a query itself. Times are counts of `clock_`.
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
  /// Counts the keyframes of `asked` that should show the other map by the similarity `other_from_asked`,
  /// were searched for at `since` or later, and were not found in any map.
  [[nodiscard]] size_t count_missing(const IndexedMap& asked, const IndexedMap& other,
                                     const Similarity3& other_from_asked, uint64_t since) const;

  OverlapOptions options_;
  uint64_t clock_ = 0;
  std::map<MapId, Entries> keyframes_;
  std::map<MapPair, std::vector<Shown>> shown_;
};

}  // namespace cairn
