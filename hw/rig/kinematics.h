// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

/// Angles of the rig's axes [rad], or their rates [rad/s]. Pan turns to the left, tilt up; at 0, 0 the camera
/// looks along the base's x.
struct PanTilt {
  double pan = 0;
  double tilt = 0;
};

/// The base from the head, which is what the tilt axis turns: its x is where the camera looks, y left, z up.
[[nodiscard]] Eigen::Quaterniond base_from_head(const PanTilt& angles);
/// The rate of the head's turn against the base while the axes turn at `rates`: [rad/s], in the head's axes.
[[nodiscard]] Eigen::Vector3d rate_of_head(const PanTilt& angles, const PanTilt& rates);

/// The motion of the head, or of the base, as an IMU on it measures it, in its own axes.
struct HeadMotion {
  Eigen::Vector3d rate;          ///< [rad/s]
  Eigen::Vector3d acceleration;  ///< [m/s^2], with the pull that holds it up
};
/// The motion of the head while the axes turn at `rates` and the base moves as `base` says.
[[nodiscard]] HeadMotion motion_of_head(const PanTilt& angles, const PanTilt& rates, const HeadMotion& base);

/// The head from a camera that looks along the head's x, upright.
[[nodiscard]] Eigen::Quaterniond nominal_head_from_camera();

/// The base from such a camera. Base: what pan turns on, x forward, y left, z up. Camera: x right, y down, z
/// forward.
[[nodiscard]] Eigen::Matrix3d base_from_camera(const PanTilt& angles);
/// The direction in which the camera looks, in the base: of length 1.
[[nodiscard]] Eigen::Vector3d optical_axis(const PanTilt& angles);
/// The angles that look along a direction of the base, of any length above 0: pan in (-pi, pi], tilt in
/// [-pi/2, pi/2]. Straight up and down every pan does: it stays `pan`.
[[nodiscard]] PanTilt look_along(const Eigen::Vector3d& direction, double pan = 0);
/// The same for a camera that looks along `axis` of the head, of length 1 and not straight to the side.
[[nodiscard]] PanTilt look_along(const Eigen::Vector3d& direction, double pan, const Eigen::Vector3d& axis);
/// How fast the axes must turn for a camera that looks along `axis` of the head, as above, to keep looking
/// along a direction that changes in the world by `moving` a second, while the base turns at `rate` [rad/s].
/// All but `axis` in the base's axes. 0 straight up and down, and where no angles look along that direction.
[[nodiscard]] PanTilt rates_to_hold(const Eigen::Vector3d& direction, const Eigen::Vector3d& axis,
                                    const Eigen::Vector3d& rate,
                                    const Eigen::Vector3d& moving = Eigen::Vector3d::Zero());

}  // namespace cairn
