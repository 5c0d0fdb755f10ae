// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/kinematics.h"

#include <cmath>

namespace cairn {
namespace {

constexpr double kUpright = 1e-6;  // of a direction's length: less of it is level, and pan is arbitrary

}  // namespace

Eigen::Quaterniond base_from_head(const PanTilt& angles) {
  return Eigen::AngleAxisd(angles.pan, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(-angles.tilt, Eigen::Vector3d::UnitY());
}

Eigen::Vector3d rate_of_head(const PanTilt& angles, const PanTilt& rates) {
  return {rates.pan * std::sin(angles.tilt), -rates.tilt, rates.pan * std::cos(angles.tilt)};
}

Eigen::Matrix3d base_from_camera(const PanTilt& angles) {
  Eigen::Matrix3d ahead;  // the camera at 0, 0
  ahead << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return base_from_head(angles) * ahead;
}

Eigen::Vector3d optical_axis(const PanTilt& angles) {
  return base_from_camera(angles).col(2);
}

PanTilt look_along(const Eigen::Vector3d& direction, double pan) {
  const double level = direction.head<2>().norm();
  const bool upright = level < kUpright * direction.norm();
  return {upright ? pan : std::atan2(direction.y(), direction.x()), std::atan2(direction.z(), level)};
}

PanTilt rates_to_hold(const Eigen::Vector3d& direction, const Eigen::Vector3d& rate,
                      const Eigen::Vector3d& moving) {
  const double length = direction.norm();
  const Eigen::Vector3d ray = direction / length;
  const double level = ray.head<2>().norm();
  if (level < kUpright) return {};
  const Eigen::Vector3d aside = (moving - moving.dot(ray) * ray) / length;
  const Eigen::Vector3d change = aside - rate.cross(ray);
  return {(ray.x() * change.y() - ray.y() * change.x()) / (level * level), change.z() / level};
}

}  // namespace cairn
