// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "client/relocalization/described_views.h"
#include "client/tracking/point_search.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/map/snapshot.h"

namespace cairn {

/// Where the camera may be in a frame, by other means than the decaying velocity and the small image, for
/// when a search from there fails: the points of the frame before, each followed from image to image; and the
/// corners of the frame, compared with how the points around the last pose looked. In this order of cost.
/// Each is worked out when it is asked for. Pure; one thread.
class PosePriors {
 public:
  /// `seed` of random choices.
  PosePriors(CameraPtr camera, uint64_t seed) : camera_(std::move(camera)), seed_(seed) {}

  /// Other values of the same camera, from now on.
  void use_camera(CameraPtr camera) { camera_ = std::move(camera); }
  /// Another frame: what was found out of the one before is forgotten, but for where its points were.
  void next_frame() { described_.reset(); }
  /// The frame was tracked, and showed these points.
  void tracked(const std::vector<VisiblePoint>& points);
  /// It was not: there is nothing to be followed into the next.
  void missed() { seen_.clear(); }
  /// The frame tracked() last is good enough to be recognized by.
  void remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose);

  /// The pose by the points of the frame before, followed from `previous` to `now`, looked for where `motion`
  /// of the small images puts them. Nothing when the frame before was not tracked, or too few are followed.
  [[nodiscard]] std::optional<SE3> by_flow(const FrameImages& previous, const FrameImages& now,
                                           const TinyMotion& motion, const MapSnapshot& map) const;
  /// The pose by the corners of `now` and the views remembered around `last`.
  [[nodiscard]] std::optional<SE3> by_corners(const FrameImages& now, const MapSnapshot& map, const SE3& last,
                                              double mean_depth);

 private:
  CameraPtr camera_;
  uint64_t seed_;
  std::vector<SeenPoint> seen_;  ///< in the frame before
  DescribedViews views_;
  std::optional<PlaceView> described_;  ///< the present frame
};

}  // namespace cairn
