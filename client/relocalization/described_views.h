// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
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

/// The pose from which a frame was taken.
struct ViewPose {
  KeyframeId reference;
  SE3 camera_from_reference;
  double mean_depth = 1;  ///< [map unit] of what it shows
};

struct DescribedViewsOptions {
  uint64_t most_views = 100;   ///< 12 kB each
  uint64_t most_points = 300;  ///< of a view
  double view_distance = 0.1;  ///< [mean depths] between views, as keyframes are apart
  double view_angle = 0.15;    ///< [rad] likewise: an eighth of the image
  uint64_t views_tried = 4;
  int most_distance = 64;   ///< [bits of 256] that may differ
  float most_ratio = 0.8F;  ///< of the distance to the second nearest (Lowe, IJCV 2004)
  int fewest_inliers = 15;  ///< of a pose that is believed
};

/// How the points of a map look in the frames that were tracked well, so that a tracker that has just lost
/// its map recognizes it by itself: corners of a frame are matched with the points of the views nearest to
/// the last pose, and a pose is fitted to the matches. Poses are kept relative to a keyframe, so they survive
/// adjustments. Bounded: the oldest views go first. Pure; one thread.
class DescribedViews {
 public:
  explicit DescribedViews(const DescribedViewsOptions& options) : options_(options) {}

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

  DescribedViewsOptions options_;
  std::deque<View> views_;
  GrayImage smoothed_;
};

}  // namespace cairn
