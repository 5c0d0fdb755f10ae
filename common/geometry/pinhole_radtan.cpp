// SPDX-License-Identifier: Apache-2.0
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/geometry/camera_models.h"
#include "common/geometry/polynomial.h"

namespace cairn {
namespace {

constexpr size_t kMaxValues = 9;
constexpr double kMinDepth = 1e-9;

/// The first u = r^2 > 0 where d(r (1 + k1 u + k2 u^2 + k3 u^3))/dr = 1 + 3 k1 u + 5 k2 u^2 + 7 k3 u^3
/// vanishes; infinity if it never does. Beyond it the model folds back over the image.
double monotonic_limit(double k1, double k2, double k3) {
  constexpr double kFar = 1e6;  // r = 1000: 89.94 degrees off the axis
  const std::array<double, 4> slope = {1, 3 * k1, 5 * k2, 7 * k3};
  return first_sign_change(slope, 0, kFar).value_or(std::numeric_limits<double>::infinity());
}

/// OpenCV's "plumb bob": radial polynomial in r^2 up to k3, tangential p1, p2.
class PinholeRadtan final : public Camera {
 public:
  explicit PinholeRadtan(const CameraParameters& parameters) : Camera(parameters) {
    std::array<double, kMaxValues> v{};
    std::copy(parameters.values.begin(), parameters.values.end(), v.begin());
    fx_ = v[0];
    fy_ = v[1];
    cx_ = v[2];
    cy_ = v[3];
    k1_ = v[4];
    k2_ = v[5];
    p1_ = v[6];
    p2_ = v[7];
    k3_ = v[8];
    distorted_ = std::any_of(v.begin() + 4, v.end(), [](double k) { return k != 0; });
    max_u_ = monotonic_limit(k1_, k2_, k3_);
  }

  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point) const override {
    if (!(point.z() > kMinDepth)) return std::nullopt;
    const double inverse_depth = 1.0 / point.z();
    const Eigen::Vector2d m(point.x() * inverse_depth, point.y() * inverse_depth);
    if (!distorted_) return to_pixel(m);
    if (m.squaredNorm() > max_u_) return std::nullopt;
    return to_pixel(distort(m));
  }

  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point,
                                         Matrix23d* d_pixel_d_point) const override {
    if (!(point.z() > kMinDepth)) return std::nullopt;
    const double inverse_depth = 1.0 / point.z();
    const Eigen::Vector2d m(point.x() * inverse_depth, point.y() * inverse_depth);
    Eigen::Vector2d d = m;
    Eigen::Matrix2d d_d_m = Eigen::Matrix2d::Identity();
    if (distorted_) {
      if (m.squaredNorm() > max_u_) return std::nullopt;
      d = distort(m, &d_d_m);
    }
    const double gx = fx_ * inverse_depth;
    const double gy = fy_ * inverse_depth;
    Matrix23d& j = *d_pixel_d_point;
    j(0, 0) = gx * d_d_m(0, 0);
    j(0, 1) = gx * d_d_m(0, 1);
    j(0, 2) = -(j(0, 0) * m.x() + j(0, 1) * m.y());
    j(1, 0) = gy * d_d_m(1, 0);
    j(1, 1) = gy * d_d_m(1, 1);
    j(1, 2) = -(j(1, 0) * m.x() + j(1, 1) * m.y());
    return to_pixel(d);
  }

  Eigen::Vector3d unproject(const Eigen::Vector2d& pixel) const override {
    const Eigen::Vector2d d((pixel.x() - cx_) / fx_, (pixel.y() - cy_) / fy_);
    const Eigen::Vector2d m = distorted_ ? undistort(d) : d;
    return Eigen::Vector3d(m.x(), m.y(), 1.0).normalized();
  }

  Eigen::Matrix2Xd d_pixel_d_parameters(const Eigen::Vector3d& point) const override {
    const double x = point.x() / point.z();
    const double y = point.y() / point.z();
    const double u = x * x + y * y;
    const Eigen::Vector2d d = distort({x, y});
    Eigen::Matrix<double, 2, kMaxValues> j;
    j << d.x(), 0, 1, 0, fx_ * x * u, fx_ * x * u * u, fx_ * 2 * x * y, fx_ * (u + 2 * x * x),
        fx_ * x * u * u * u,  //
        0, d.y(), 0, 1, fy_ * y * u, fy_ * y * u * u, fy_ * (u + 2 * y * y), fy_ * 2 * x * y,
        fy_ * y * u * u * u;
    return j.leftCols(static_cast<Eigen::Index>(parameters().values.size()));
  }

 private:
  [[nodiscard]] Eigen::Vector2d to_pixel(const Eigen::Vector2d& d) const {
    return {fx_ * d.x() + cx_, fy_ * d.y() + cy_};
  }

  [[nodiscard]] Eigen::Vector2d distort(const Eigen::Vector2d& m) const {
    const double x = m.x();
    const double y = m.y();
    const double u = x * x + y * y;
    const double radial = 1 + u * (k1_ + u * (k2_ + u * k3_));
    return {x * radial + 2 * p1_ * x * y + p2_ * (u + 2 * x * x),
            y * radial + p1_ * (u + 2 * y * y) + 2 * p2_ * x * y};
  }

  [[nodiscard]] Eigen::Vector2d distort(const Eigen::Vector2d& m, Eigen::Matrix2d* jacobian) const {
    const double x = m.x();
    const double y = m.y();
    const double u = x * x + y * y;
    const double radial = 1 + u * (k1_ + u * (k2_ + u * k3_));
    const double d_radial = 2 * (k1_ + u * (2 * k2_ + u * 3 * k3_));  // d radial / d x = x * d_radial
    // Entry by entry: with a comma initializer here, g++ 12.2 -O3 -DNDEBUG drops the stores after the first
    // (-fipa-modref; checked by camera_test).
    (*jacobian)(0, 0) = radial + x * x * d_radial + 2 * p1_ * y + 6 * p2_ * x;
    (*jacobian)(0, 1) = (*jacobian)(1, 0) = x * y * d_radial + 2 * (p1_ * x + p2_ * y);
    (*jacobian)(1, 1) = radial + y * y * d_radial + 6 * p1_ * y + 2 * p2_ * x;
    return {x * radial + 2 * p1_ * x * y + p2_ * (u + 2 * x * x),
            y * radial + p1_ * (u + 2 * y * y) + 2 * p2_ * x * y};
  }

  /// Newton from the distorted point: for a concave radial curve (barrel) it approaches from inside and for a
  /// convex one from outside, so it does not overshoot. A pixel that no ray reaches ends on the rim of the
  /// valid field.
  [[nodiscard]] Eigen::Vector2d undistort(const Eigen::Vector2d& d) const {
    constexpr int kMaxIterations = 20;
    constexpr double kConverged = 1e-24;  // squared step; quadratic convergence leaves rounding only
    Eigen::Vector2d m = d;
    for (int i = 0; i < kMaxIterations; ++i) {
      if (const double u = m.squaredNorm(); u > max_u_) m *= std::sqrt(max_u_ / u) * (1 - 1e-12);
      Eigen::Matrix2d jacobian;
      const Eigen::Vector2d error = distort(m, &jacobian) - d;
      const double determinant = jacobian.determinant();
      if (!(determinant > 1e-12)) break;
      const Eigen::Vector2d step((jacobian(1, 1) * error.x() - jacobian(0, 1) * error.y()) / determinant,
                                 (jacobian(0, 0) * error.y() - jacobian(1, 0) * error.x()) / determinant);
      m -= step;
      if (step.squaredNorm() < kConverged) break;
    }
    if (const double u = m.squaredNorm(); u > max_u_) m *= std::sqrt(max_u_ / u) * (1 - 1e-12);
    return m;
  }

  double fx_, fy_, cx_, cy_, k1_, k2_, p1_, p2_, k3_;
  bool distorted_ = false;
  double max_u_ = 0;
};

}  // namespace

CameraPtr make_pinhole_radtan(const CameraParameters& parameters) {
  return std::make_shared<const PinholeRadtan>(parameters);
}

}  // namespace cairn
