// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

namespace cairn {

/// The tiny image by which places are compared, by client and server alike.
[[nodiscard]] TinyImage place_image(const FrameImages& frame);

/// The rotation of the camera between two place images (now_from_then). The identity where they have nothing
/// in common.
[[nodiscard]] SE3 turn_between(const TinyImage& then, const TinyImage& now, const Camera& camera);

struct PlaceMemoryOptions {
  uint64_t most_views = 400;    ///< 5 kB each
  double view_distance = 0.05;  ///< [mean depths] between views
  double view_angle = 0.07;     ///< [rad] likewise
};

/// The tracker's own memory of where it was: tiny images of frames it tracked well with their poses (Klein
/// and Murray, ECCV 2008, kept at the client), so that a tracker that is lost finds back to where it has been
/// without asking anyone. Poses are kept relative to a keyframe, so they survive adjustments and a server
/// that comes back with the map. Of all maps that it was in; bounded: the oldest views go first. One thread.
class PlaceMemory {
 public:
  explicit PlaceMemory(const PlaceMemoryOptions& options) : options_(options) {}

  /// Remembers a frame if its camera is far enough from the views remembered last.
  void remember(const FrameImages& frame, const MapSnapshot& map, KeyframeId reference,
                const SE3& camera_from_reference, double mean_depth);
  /// The pose in `map` of the view whose tiny image is nearest to the frame's, turned as the tiny images say.
  /// `skip` passes over the best ones: successive frames try successive candidates.
  [[nodiscard]] std::optional<SE3> recall(const FrameImages& frame, const Camera& camera,
                                          const MapSnapshot& map, size_t skip);

 private:
  struct View {
    TinyImage tiny;
    MapId map;
    KeyframeId reference;
    SE3 camera_from_reference;
  };
  PlaceMemoryOptions options_;
  std::deque<View> views_;
  std::vector<std::pair<float, size_t>> ranked_;  ///< kept for its memory
};

}  // namespace cairn
