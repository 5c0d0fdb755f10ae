// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/pose.h"
#include "common/geometry/se3.h"
#include "common/image/descriptor.h"
#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/map/snapshot.h"

namespace cairn {

/// A map point where a frame was found to show it.
struct SeenPoint {
  PointId id;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0
  uint8_t level = 0;
};

/// Where a frame was taken.
struct ViewPose {
  KeyframeId reference;
  SE3 camera_from_reference;
  double mean_depth = 1;  ///< [map unit] of what it shows
};

/// How the points of a map look in the frames that were tracked well, so that a tracker that has just lost
/// its map recognizes it by itself: corners of a frame are matched with the points of the views nearest to
/// the last pose, and a pose is fitted to the matches. Poses are kept relative to a keyframe, so they survive
/// adjustments. Bounded: the oldest views go first. Pure; one thread.
class DescribedViews {
 public:
  /// Describes the points of a frame if its camera is far enough from the views described so far.
  void remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose,
                std::span<const SeenPoint> points);
  /// Whether there are views of this map.
  [[nodiscard]] bool knows(const MapSnapshot& map) const;
  /// The pose of a frame in `map` by its corners, compared with the views nearest to `last`; nothing where
  /// too few agree. `mean_depth` [map unit] of what it showed last; `seed` of the random choices.
  [[nodiscard]] std::optional<SE3> recognize(const PlaceView& frame, const Camera& camera,
                                             const MapSnapshot& map, const SE3& last, double mean_depth,
                                             uint64_t seed) const;

 private:
  struct View {
    MapId map;
    ViewPose pose;
    std::vector<PointId> points;
    std::vector<Descriptor> descriptors;  ///< of each
  };

  [[nodiscard]] bool is_near_another(const MapSnapshot& map, const ViewPose& pose) const;
  [[nodiscard]] std::vector<const View*> nearest(const MapSnapshot& map, const SE3& last,
                                                 double mean_depth) const;
  [[nodiscard]] std::vector<PointObservation> match(const PlaceView& frame, const MapSnapshot& map,
                                                    std::span<const View* const> views) const;

  std::deque<View> views_;
  GrayImage smoothed_;
};

}  // namespace cairn
