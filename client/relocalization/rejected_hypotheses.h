// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "client/relocalization/pose_hypothesis.h"
#include "common/base/time.h"

namespace cairn {

struct RejectedHypothesesOptions {
  int enough = 8;          ///< times in vain; blur alone may spoil some
  double remembered = 10;  ///< [s] after the latest
};

/// Hypotheses that verification has refused again and again: they are left out for a while, and a builder
/// that is told of no other may take its place for a new one. Times are of the frames. One thread.
class RejectedHypotheses {
 public:
  explicit RejectedHypotheses(const RejectedHypothesesOptions& options) : options_(options) {}

  void reject(const PoseHypothesis& place, Timestamp time);
  [[nodiscard]] bool is_rejected(const PoseHypothesis& place, Timestamp time) const;
  /// Something was verified there after all.
  void forget() { places_.clear(); }

 private:
  struct Place {
    MapId map;
    Epoch epoch;
    KeyframeId reference;
    int times = 0;
    Timestamp latest;
  };
  RejectedHypothesesOptions options_;
  std::vector<Place> places_;
};

}  // namespace cairn
