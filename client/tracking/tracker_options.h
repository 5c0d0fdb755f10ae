// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace cairn {

struct TrackerOptions {
  int max_points = 1100;  ///< patches searched per frame; PTAM r114 has 1000, of which sim-desk shows 490
  int coarse_points = 60;
  float coarse_radius = 30;  ///< [px of level 0]
  float fine_radius = 10;    ///< [px of level 0] without a coarse stage before
  float fine_radius_after_coarse = 5;
  float good_quality = 0.3F;   ///< share found of those in sight; below, a frame is poor
  float lost_quality = 0.13F;  ///< of points on the top two levels; below: a bad frame
  int lost_after_bad_frames = 3;
  int frames_between_keyframes = 20;
  double keyframe_distance =
      0.1;  ///< to the nearest keyframe, over the mean depth (PTAM: 0.1 m over the first depth)
  float running_out = 0.9F;    ///< of the points found at best since the last keyframe: below, one is needed
                               ///< soon if the frame shows what the map does not know
  float few_left = 0.7F;       ///< of those points: below, one is needed soon whatever the frame shows
  int scarce_points = 120;     ///< found: fewer are soon too few to build upon, whatever was found before
  double need_distance = 0.1;  ///< of keyframe_distance, which is enough then
  int trail_count = 1000;      ///< trails begun in the first frame
  bool make_maps = true;       ///< seeds are proposed while there is no map
  bool make_keyframes = true;  ///< keyframes are proposed
  uint64_t seed = 1;
};

}  // namespace cairn
