// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "client/relocalization/described_views.h"
#include "client/tracking/patch_flow.h"
#include "client/tracking/point_search.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

namespace cairn {

struct FlowPriorOptions {
  uint64_t most_followed = 150;  ///< points, of those found in the frame before
  int fewest_followed = 12;      ///< points that agree on a pose, as in the coarse stage
  PatchFlowOptions patches;
};

/// Finds the camera in a frame by the points of the frame before, each followed from image to image. It
/// serves when a search from where the velocity and the small image expect the camera fails. Pure; one
/// thread.
class FlowPrior {
 public:
  /// `seed` of random choices.
  FlowPrior(CameraPtr camera, uint64_t seed, const FlowPriorOptions& options)
      : camera_(std::move(camera)), seed_(seed), options_(options) {}

  /// Other values of the same camera, from now on.
  void use_camera(CameraPtr camera) { camera_ = std::move(camera); }
  /// The frame was tracked, and showed these points.
  void tracked(const std::vector<VisiblePoint>& points);
  /// The frame was not tracked: there is nothing to be followed into the next.
  void missed() { seen_.clear(); }
  /// The points that the latest frame showed.
  [[nodiscard]] std::span<const SeenPoint> seen() const { return seen_; }

  /// The pose of `now`, the points being looked for where `motion` of the small images puts them. Nothing
  /// when the frame before (`previous`) was not tracked, or too few are followed.
  [[nodiscard]] std::optional<SE3> pose(const FrameImages& previous, const FrameImages& now,
                                        const TinyMotion& motion, const MapSnapshot& map) const;

 private:
  CameraPtr camera_;
  uint64_t seed_;
  FlowPriorOptions options_;
  std::vector<SeenPoint> seen_;
};

}  // namespace cairn
