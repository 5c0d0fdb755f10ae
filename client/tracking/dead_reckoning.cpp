// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/dead_reckoning.h"

namespace cairn {

std::optional<DeadReckoning::Reckoned> DeadReckoning::by_corners(const FrameImages& now, const SE3& expected,
                                                                 std::span<const VisiblePoint> map_points,
                                                                 const Depths& depths,
                                                                 const MapSnapshot& map) {
  corners_.follow(now, expected, map);
  const auto located = corners_.locate(expected, map_points, depths.mean);
  if (!located) return std::nullopt;
  blind_frames_ = 0;
  ++frames_;
  corners_.update(
      now, {located->camera_from_map, located->covariance, located->judgement.support, depths.mean}, map, {});
  // It may be known well enough to turn about, and not to stand still beside what is near.
  const bool stands_still =
      located->judgement.support == PoseSupport::kPosition &&
      located->judgement.position_sigma * depths.mean < judgement_.known_position * depths.near;
  return Reckoned{located->camera_from_map, stands_still && frames_ <= options_.position_held};
}

void DeadReckoning::follow_turn(const FrameImages& now, const SE3& camera_from_map, double sigma,
                                double mean_depth, const MapSnapshot& map) {
  ++blind_frames_;
  ++frames_;
  Vector6d sigmas;
  sigmas << Eigen::Vector3d::Constant(sigma * mean_depth), Eigen::Vector3d::Constant(sigma);
  const Matrix6d covariance = sigmas.cwiseAbs2().asDiagonal();
  corners_.update(now, {camera_from_map, covariance, PoseSupport::kRotation, mean_depth}, map, {});
}

bool DeadReckoning::follow_small_images(const FrameImages& now, const SE3& camera_from_map, float likeness,
                                        double mean_depth, const MapSnapshot& map) {
  if (frames_ == 0 || likeness < options_.same_turn || blind_frames_ >= options_.blind) return false;
  follow_turn(now, camera_from_map, options_.blind_sigma, mean_depth, map);
  return true;
}

}  // namespace cairn
