// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/kinematics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

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

HeadMotion motion_of_head(const PanTilt& angles, const PanTilt& rates, const HeadMotion& base) {
  const Eigen::Quaterniond head_from_base = base_from_head(angles).conjugate();
  return {head_from_base * base.rate + rate_of_head(angles, rates), head_from_base * base.acceleration};
}

Eigen::Quaterniond nominal_head_from_camera() {
  Eigen::Matrix3d ahead;
  ahead << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return Eigen::Quaterniond(ahead);
}

Eigen::Matrix3d base_from_camera(const PanTilt& angles) {
  return (base_from_head(angles) * nominal_head_from_camera()).toRotationMatrix();
}

Eigen::Vector3d optical_axis(const PanTilt& angles) {
  return base_from_camera(angles).col(2);
}

PanTilt look_along(const Eigen::Vector3d& direction, double pan) {
  const double level = direction.head<2>().norm();
  const bool upright = level < kUpright * direction.norm();
  return {upright ? pan : std::atan2(direction.y(), direction.x()), std::atan2(direction.z(), level)};
}

PanTilt look_along(const Eigen::Vector3d& direction, double pan, const Eigen::Vector3d& axis) {
  const Eigen::Vector3d ray = direction.normalized();
  const double upright = std::hypot(axis.x(), axis.z());
  const double tilt = std::asin(std::clamp(ray.z() / upright, -1.0, 1.0)) - std::atan2(axis.z(), axis.x());
  const Eigen::Vector3d tilted = base_from_head({0, tilt}) * axis;
  if (ray.head<2>().norm() < kUpright) return {pan, tilt};
  const double turn = std::atan2(ray.y(), ray.x()) - std::atan2(tilted.y(), tilted.x());
  return {std::remainder(turn, 2 * std::numbers::pi), tilt};
}

PanTilt rates_to_hold(const Eigen::Vector3d& direction, const Eigen::Vector3d& axis,
                      const Eigen::Vector3d& rate, const Eigen::Vector3d& moving) {
  const double length = direction.norm();
  const Eigen::Vector3d ray = direction / length;
  // As the tilt axis, which stays level, has it: what lies along that axis does not change by tilt.
  const double level = ray.head<2>().squaredNorm();
  const double ahead = std::sqrt(std::max(0.0, level - axis.y() * axis.y()));
  if (ahead < kUpright) return {};
  const Eigen::Vector3d aside = (moving - moving.dot(ray) * ray) / length;
  const Eigen::Vector3d change = aside - rate.cross(ray);
  const double tilt = change.z() / ahead;
  const double around = (ray.x() * change.y() - ray.y() * change.x()) / level;
  return {around - tilt * ray.z() * axis.y() / level, tilt};
}

}  // namespace cairn
