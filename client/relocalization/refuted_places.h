// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "client/relocalization/pose_suggestion.h"
#include "common/base/time.h"

namespace cairn {

/// Places that were suggested and tried in vain again and again: they are not tried for a while, and a
/// builder that is told of nothing else may take its place for a new one. Times are of the frames. One
/// thread.
class RefutedPlaces {
 public:
  void refute(const PoseSuggestion& place, Timestamp time);
  [[nodiscard]] bool is_refuted(const PoseSuggestion& place, Timestamp time) const;
  /// Something was proven there after all.
  void forget() { places_.clear(); }

 private:
  struct Place {
    MapId map;
    Epoch epoch;
    KeyframeId reference;
    int times = 0;
    Timestamp latest;
  };
  std::vector<Place> places_;
};

}  // namespace cairn
