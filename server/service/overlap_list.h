// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "server/relocalization/overlap_detector.h"
#include "server/store/overlap_record.h"

namespace cairn {

/// The overlaps that are known of, also of maps that have been deleted and may come back: what has been seen
/// once is not taken back. Used from one thread.
class OverlapList {
 public:
  /// A map that overlaps with the one that was asked about.
  struct Neighbour {
    MapId map;
    size_t keyframes = 0;      ///< of the map asked about that show this one, the most there have been
    size_t its_keyframes = 0;  ///< of this one that show the map asked about
    Timestamp found;
  };

  void restore(const std::vector<OverlapRecord>& records);
  /// Notes an overlap. Returns whether it is new.
  bool note(const Overlap& overlap, Timestamp now);
  /// Forgets a map that is gone for good.
  void forget(const MapId& map);

  /// Maps that overlap with this one, by how many keyframes of both show the other map, the most first.
  [[nodiscard]] std::vector<Neighbour> of(const MapId& map) const;
  [[nodiscard]] std::vector<OverlapRecord> all() const;
  /// Whether all() has changed since this was last called.
  [[nodiscard]] bool take_changed();
  /// Makes take_changed() true again, since what was taken could not be kept.
  void change_again() { is_changed_ = true; }

 private:
  std::map<MapPair, OverlapRecord> overlaps_;
  bool is_changed_ = false;
};

}  // namespace cairn
