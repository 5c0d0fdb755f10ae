// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>

#include "client/app/frame_observer.h"
#include "common/base/time.h"

namespace cairn {

/// How long a tracker has been lost in a place that no map shows, by the stamps of its frames, so that a run
/// in lockstep is repeatable. Pure; one thread.
class LostWatch {
 public:
  void frame(FrameState state, Timestamp time) {
    constexpr std::chrono::nanoseconds kLongestStep =
        std::chrono::milliseconds(500);  // a cut is no long wait
    if (state != FrameState::kLost) {
      *this = {};
      return;
    }
    const auto step = std::clamp(time - lost_at_.value_or(time), std::chrono::nanoseconds(0), kLongestStep);
    lost_at_ = time;
    told_before_ += step;
    if (is_not_known_ && told_before_ <= kFresh) unmapped_for_ += step;
  }
  /// The relocalizer has said whether it knows the place.
  void answered(bool is_known) {
    is_not_known_ = !is_known;
    told_before_ = {};
    if (is_known) unmapped_for_ = {};
  }
  [[nodiscard]] std::chrono::nanoseconds unmapped_for() const { return unmapped_for_; }

 private:
  static constexpr std::chrono::nanoseconds kFresh = std::chrono::seconds(1);
  std::optional<Timestamp> lost_at_;  ///< stamp of the frame before, if it was lost
  bool is_not_known_ = false;
  std::chrono::nanoseconds told_before_{0};  ///< age of the latest answer
  std::chrono::nanoseconds unmapped_for_{0};
};

}  // namespace cairn
