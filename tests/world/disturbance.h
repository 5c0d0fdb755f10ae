// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "tests/world/scenario.h"

namespace cairn {

/// Events of one kind, spread over time: one in each of equal slots, none within the first seconds (a map
/// needs a start). A pure function of time.
class EventTrain {
 public:
  /// No events at a rate of 0. `duration` [s] must be shorter than half a slot.
  EventTrain(double per_minute, double duration, uint64_t seed, uint64_t stream);

  struct Moment {
    uint64_t event = 0;  ///< number
    double part = 0;     ///< of its duration that is over, 0 to 1
  };
  /// The event that is going on.
  [[nodiscard]] std::optional<Moment> at(double seconds) const;

 private:
  double per_minute_;
  double duration_;
  uint64_t seed_;
  uint64_t stream_;
};

/// Adds a hand on its arm, as a body of its own in front of the camera; returns the body's index.
size_t add_hand(uint64_t seed, Scenario* scenario);
/// Pose of the hand as it comes in from the right, stays before the lens and leaves; `part` from 0 to 1.
[[nodiscard]] SE3 camera_from_hand(double part);

/// A jerk of the camera to one side and back, about its own axes, up to 25 degrees.
[[nodiscard]] SE3 jerk(double part, uint64_t event, uint64_t seed);

}  // namespace cairn
