// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "client/tracking/tracker_options.h"

namespace cairn {

/// When a frame is worth offering as a keyframe: far enough from those of the map, not too soon
/// after the last, sooner where the map runs out under the camera. Pure; one thread.
class KeyframePolicy {
 public:
  explicit KeyframePolicy(const TrackerOptions& options) : options_(options) {}

  /// Another frame has come, tracked or not.
  void next_frame() { ++since_; }
  /// Another map: what was found in the one before means nothing here.
  void enter_map() { most_found_ = 0; }
  /// Whether to offer a well tracked frame with `found` points whose camera is `distance` (over the mean
  /// depth) from the nearest keyframe. Yes counts as offered. `is_new_area`: whether the map knows little of
  /// what the frame shows; asked only where the answer depends on it.
  [[nodiscard]] bool wants(int found, double distance, const std::function<bool()>& is_new_area);

 private:
  [[nodiscard]] bool is_due(int found, double distance, const std::function<bool()>& is_new_area) const;

  TrackerOptions options_;
  int since_ = 0;       ///< frames since the last offer
  int most_found_ = 0;  ///< in a frame since then
};

}  // namespace cairn
