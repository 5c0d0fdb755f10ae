// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>

namespace cairn {

struct KeyframePolicyOptions {
  /// [frames] between two offers at `distance`; fewer farther away (PTAM r114)
  int frames_between = 20;
  /// Share of `frames_between` that always passes between two offers. It is enough in a young map, where the
  /// map runs out, and far beyond `distance`: a camera that moves fast would run out of its map.
  double shortest_wait = 0.1;
  double distance = 0.1;  ///< to the nearest keyframe, over the mean depth (PTAM: 0.1 m over the first depth)
  /// Share of the most points found in a frame since the last offer, whether or not the server took that.
  /// Below, a keyframe is needed soon if the frame shows what the map does not know.
  float running_out = 0.9F;
  float few_left = 0.7F;       ///< of those points: below, one is needed soon whatever the frame shows
  int scarce_points = 120;     ///< found: fewer are soon too few to build upon, whatever was found before
  double need_distance = 0.1;  ///< of `distance`, which is enough where a keyframe is needed soon
  /// The corners that tell what the map does not know (map_growth): their level, least FAST score and least
  /// texture.
  int area_level = 1;          ///< as the server's own
  int area_barrier = 10;       ///< [grey levels] of FAST's score (PTAM r114)
  float area_texture = 70.0F;  ///< Shi-Tomasi's measure (PTAM r114)
};

/// Decides when a frame is worth offering as a keyframe: far enough from those of the map, not too soon after
/// the last, sooner where the map runs out under the camera. Pure; one thread.
class KeyframePolicy {
 public:
  explicit KeyframePolicy(const KeyframePolicyOptions& options) : options_(options) {}

  /// Another frame has come, tracked or not.
  void next_frame() { ++since_; }
  /// Another map: what was found in the one before means nothing here.
  void enter_map() { forget_found(0); }
  /// Whether to offer a well tracked frame with `found` points whose camera is `distance` (over the mean
  /// depth) from the nearest keyframe. Yes counts as offered. `widens_map`: it brings parallax that a young
  /// map needs (widens_young_map). `is_new_area`: whether the map knows little of what the frame shows. That
  /// costs time: it is asked only where the answer depends on it, and after a no only once fewer points are
  /// found than then.
  [[nodiscard]] bool wants(int found, double distance, bool widens_map,
                           const std::function<bool()>& is_new_area);

 private:
  [[nodiscard]] bool is_due(int found, double distance, bool widens_map,
                            const std::function<bool()>& is_new_area);
  [[nodiscard]] bool shows_new_area(int found, const std::function<bool()>& is_new_area);
  void forget_found(int found);

  KeyframePolicyOptions options_;
  int since_ = 0;                           ///< frames since the last offer
  int most_found_ = 0;                      ///< in a frame since then
  std::optional<int> found_in_known_area_;  ///< in the last frame that was looked at and showed nothing new
};

}  // namespace cairn
