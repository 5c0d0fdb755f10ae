// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "client/app/overlay.h"
#include "client/tracking/tracker.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/map/label.h"
#include "common/map/snapshot.h"

/// The labels that are seen in an image with a pose, and the place that a person points at in it. Pure;
/// distances within the image grow with its width. Pixels are those of level 0.
namespace cairn {

/// A map point that the tracker found in the image.
struct PointInView {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< camera frame
};
[[nodiscard]] std::vector<PointInView> seen_points(std::span<const TrackedPoint> points,
                                                   const MapSnapshot& map, const SE3& camera_from_map);

struct LabelInView {
  Label label;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double distance = 0;  ///< from the camera [map unit]
  bool hidden = false;  ///< behind something
};
/// The labels whose place lies in the image, farthest first. One is hidden if at least two points found
/// around it are clearly nearer than it is, and more of them than are not.
[[nodiscard]] std::vector<LabelInView> labels_in_view(const std::vector<Label>& labels,
                                                      const SE3& camera_from_map, const Camera& camera,
                                                      std::span<const PointInView> seen);
/// None without a pose measured in the frame.
[[nodiscard]] std::vector<LabelInView> labels_in_view(const OverlayFrame& frame, const Camera& camera);

/// The place (camera frame) that somebody means who points at a pixel: the point found next to it or else,
/// where there is none, the surface that the points around it lie on. Nothing where no point is near.
[[nodiscard]] std::optional<Eigen::Vector3d> pick_place(const Eigen::Vector2d& pixel, const Camera& camera,
                                                        std::span<const PointInView> seen);

}  // namespace cairn
