// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/triangulation.h"

#include <cmath>

namespace cairn {

// The epipolar plane with normal n (n orthogonal to the baseline) that minimizes (n.ray_a)^2 + (n.ray_b)^2,
// the sum of squared sines of both angular errors, is a 2x2 eigenvector (Oliensis 2002; Lee and Civera, ICCV
// 2019, sec. 4); rays turned into that plane meet in the optimal point. Closed form: no start value, no
// iteration.
Result<Eigen::Vector3d> triangulate(const SE3& b_from_a, const Eigen::Vector3d& ray_a,
                                    const Eigen::Vector3d& ray_b) {
  const Eigen::Vector3d center = b_from_a.center();
  const Eigen::Vector3d ray_b_in_a = b_from_a.rotation().conjugate() * ray_b;
  const double baseline = center.norm();
  if (!(baseline > 0)) return fail(ErrorCode::kDegenerate, "triangulation: the cameras are in one place");

  const Eigen::Vector3d axis = center / baseline;
  const Eigen::Vector3d u = axis.unitOrthogonal();
  const Eigen::Vector3d v = axis.cross(u);
  const Eigen::Vector2d a(u.dot(ray_a), v.dot(ray_a));
  const Eigen::Vector2d b(u.dot(ray_b_in_a), v.dot(ray_b_in_a));
  // Direction of the principal axis of a a^T + b b^T; the normal is orthogonal to it.
  const double angle = 0.5 * std::atan2(2 * (a.x() * a.y() + b.x() * b.y()),
                                        a.x() * a.x() + b.x() * b.x() - a.y() * a.y() - b.y() * b.y());
  const Eigen::Vector3d normal = -std::sin(angle) * u + std::cos(angle) * v;
  const Eigen::Vector3d in_plane_a = ray_a - normal.dot(ray_a) * normal;
  const Eigen::Vector3d in_plane_b = ray_b_in_a - normal.dot(ray_b_in_a) * normal;

  const double sine = normal.dot(in_plane_a.cross(in_plane_b));
  if (!(std::abs(sine) > 1e-9)) return fail(ErrorCode::kDegenerate, "triangulation: the rays are parallel");
  const double range_a = normal.dot(center.cross(in_plane_b)) / sine;
  const double range_b = normal.dot(center.cross(in_plane_a)) / sine;
  if (!(range_a > 0 && range_b > 0))
    return fail(ErrorCode::kDegenerate, "triangulation: the point lies behind a camera");
  return Eigen::Vector3d(range_a * in_plane_a);
}

double parallax(const Eigen::Vector3d& point, const Eigen::Vector3d& center_a,
                const Eigen::Vector3d& center_b) {
  const Eigen::Vector3d to_a = center_a - point;
  const Eigen::Vector3d to_b = center_b - point;
  return std::atan2(to_a.cross(to_b).norm(), to_a.dot(to_b));
}

}  // namespace cairn
