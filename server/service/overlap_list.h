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
  /// What another map has to do with one.
  struct Neighbour {
    MapId map;
    size_t keyframes = 0;      ///< of the one that show the other, the most there have been
    size_t its_keyframes = 0;  ///< the other way round
    Timestamp found;
  };

  void restore(const std::vector<OverlapRecord>& records);
  /// Whether it is new.
  bool note(const Overlap& overlap, Timestamp now);
  /// The map is gone for good.
  void forget(const MapId& map);

  /// Those with most keyframes first.
  [[nodiscard]] std::vector<Neighbour> of(const MapId& map) const;
  [[nodiscard]] std::vector<OverlapRecord> all() const;
  /// Whether all() is another than when it was last asked.
  [[nodiscard]] bool take_changed();
  /// What was taken could not be kept.
  void change_again() { is_changed_ = true; }

 private:
  std::map<MapPair, OverlapRecord> overlaps_;
  bool is_changed_ = false;
};

}  // namespace cairn
