// SPDX-License-Identifier: Apache-2.0
// Cameras whose distortion depends on the angle to the optical axis alone: Kannala-Brandt and field-of-view.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/geometry/camera_models.h"
#include "common/geometry/polynomial.h"

namespace cairn {
namespace {

/// Distance from the principal point, in focal lengths, at which a point is seen, and its derivatives by the
/// point's distance r from the axis and its depth z.
struct ImageRadius {
  double value = 0;
  double by_r = 0;
  double by_z = 0;
};

/// A ray's part across the axis and along it.
struct AxialRay {
  double across = 0;
  double along = 1;
};

/// theta_d = theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9 with theta = atan2(r, z).
class KannalaBrandtCurve {
 public:
  static constexpr size_t kValues = 4;

  explicit KannalaBrandtCurve(const std::array<double, kValues>& k) : k_(k) {
    // In u = theta^2 the slope is 1 + 3 k1 u + 5 k2 u^2 + 7 k3 u^3 + 9 k4 u^4.
    constexpr double kAllAround = std::numbers::pi;
    const std::array<double, 5> slope = {1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]};
    max_theta_ =
        std::sqrt(first_sign_change(slope, 0, kAllAround * kAllAround).value_or(kAllAround * kAllAround));
    max_radius_ = radius_at(max_theta_);
  }

  [[nodiscard]] std::optional<ImageRadius> at(double r, double z) const {
    const double squared = r * r + z * z;
    if (!(squared > 0) || (r == 0 && z < 0)) return std::nullopt;
    const double theta = std::atan2(r, z);
    if (theta > max_theta_) return std::nullopt;
    const double slope = slope_at(theta) / squared;
    return ImageRadius{radius_at(theta), slope * z, -slope * r};
  }

  [[nodiscard]] AxialRay ray_at(double radius) const {
    const double theta = radius < max_radius_ ? theta_at(radius) : max_theta_;
    return {std::sin(theta), std::cos(theta)};
  }

  [[nodiscard]] std::array<double, kValues> radius_by_values(double r, double z) const {
    const double theta = std::atan2(r, z);
    const double u = theta * theta;
    return {theta * u, theta * u * u, theta * u * u * u, theta * u * u * u * u};
  }

 private:
  [[nodiscard]] double radius_at(double theta) const {
    const double u = theta * theta;
    return theta * (1 + u * (k_[0] + u * (k_[1] + u * (k_[2] + u * k_[3]))));
  }
  [[nodiscard]] double slope_at(double theta) const {
    const double u = theta * theta;
    return 1 + u * (3 * k_[0] + u * (5 * k_[1] + u * (7 * k_[2] + u * 9 * k_[3])));
  }

  /// Newton, kept within the shrinking interval that holds the root.
  [[nodiscard]] double theta_at(double radius) const {
    constexpr int kMaxIterations = 60;
    double low = 0;
    double high = max_theta_;
    double theta = std::min(radius, 0.5 * high);
    for (int i = 0; i < kMaxIterations; ++i) {
      const double error = radius_at(theta) - radius;
      (error > 0 ? high : low) = theta;
      double next = theta - error / slope_at(theta);
      if (!(next >= low && next <= high)) next = 0.5 * (low + high);
      const double step = std::abs(next - theta);
      theta = next;
      if (step <= 4 * std::numeric_limits<double>::epsilon() * theta) break;
    }
    return theta;
  }

  std::array<double, kValues> k_;
  double max_theta_ = 0;
  double max_radius_ = 0;
};

/// radius = atan(2 tan(w / 2) r / z) / w; with atan2 it goes on behind the camera. w = 0: r / z.
class FovCurve {
 public:
  static constexpr size_t kValues = 1;

  explicit FovCurve(const std::array<double, kValues>& values)
      : w_(values[0]), a_(2 * std::tan(0.5 * values[0])) {}

  [[nodiscard]] std::optional<ImageRadius> at(double r, double z) const {
    if (w_ == 0) {
      if (!(z > kMinDepth)) return std::nullopt;
      return ImageRadius{r / z, 1 / z, -r / (z * z)};
    }
    const double squared = z * z + a_ * a_ * r * r;
    if (!(squared > 0) || (r == 0 && z < 0)) return std::nullopt;
    const double slope = a_ / (w_ * squared);
    return ImageRadius{std::atan2(a_ * r, z) / w_, slope * z, -slope * r};
  }

  [[nodiscard]] AxialRay ray_at(double radius) const {
    if (w_ == 0) return {radius, 1};
    const double angle = std::min(radius * w_, std::numbers::pi);
    return {std::sin(angle) / a_, std::cos(angle)};
  }

  [[nodiscard]] std::array<double, kValues> radius_by_values(double r, double z) const {
    constexpr double kSmall = 1e-3;  // below, the closed form cancels; the series is off by less than w^3
    if (w_ < kSmall) {
      const double x = r / z;
      return {2 * w_ * x * (1.0 / 12 - x * x / 3)};
    }
    const double cosine = std::cos(0.5 * w_);
    const double by_a = r * z / (z * z + a_ * a_ * r * r);
    return {(by_a / (cosine * cosine) - std::atan2(a_ * r, z) / w_) / w_};
  }

 private:
  static constexpr double kMinDepth = 1e-9;
  double w_;
  double a_;
};

template <typename Curve>
class AxialCamera final : public Camera {
 public:
  explicit AxialCamera(const CameraParameters& parameters)
      : Camera(parameters),
        fx_(parameters.values[0]),
        fy_(parameters.values[1]),
        cx_(parameters.values[2]),
        cy_(parameters.values[3]),
        curve_(coefficients(parameters)) {}

  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point) const override {
    const double r = std::hypot(point.x(), point.y());
    const auto radius = curve_.at(r, point.z());
    if (!radius) return std::nullopt;
    return to_pixel(point, scale(*radius, r));
  }

  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point,
                                         Matrix23d* d_pixel_d_point) const override {
    const double r = std::hypot(point.x(), point.y());
    const auto radius = curve_.at(r, point.z());
    if (!radius) return std::nullopt;
    // m = s (x, y) with s = radius / r: dm/d(x, y) = s 1 + n n^T (radius' - s), n the unit vector along (x,
    // y).
    const double s = scale(*radius, r);
    const double nx = r > 0 ? point.x() / r : 0;
    const double ny = r > 0 ? point.y() / r : 0;
    const double stretch = radius->by_r - s;
    Matrix23d& j = *d_pixel_d_point;
    j(0, 0) = fx_ * (s + nx * nx * stretch);
    j(0, 1) = fx_ * nx * ny * stretch;
    j(0, 2) = fx_ * nx * radius->by_z;
    j(1, 0) = fy_ * nx * ny * stretch;
    j(1, 1) = fy_ * (s + ny * ny * stretch);
    j(1, 2) = fy_ * ny * radius->by_z;
    return to_pixel(point, s);
  }

  Eigen::Vector3d unproject(const Eigen::Vector2d& pixel) const override {
    const Eigen::Vector2d m((pixel.x() - cx_) / fx_, (pixel.y() - cy_) / fy_);
    const double radius = m.norm();
    if (!(radius > 0)) return Eigen::Vector3d::UnitZ();
    const AxialRay ray = curve_.ray_at(radius);
    const double across = ray.across / radius;
    return Eigen::Vector3d(m.x() * across, m.y() * across, ray.along).normalized();
  }

  Eigen::Matrix2Xd d_pixel_d_parameters(const Eigen::Vector3d& point) const override {
    const double r = std::hypot(point.x(), point.y());
    const auto radius = curve_.at(r, point.z());
    const double s = radius ? scale(*radius, r) : 0;
    Eigen::Matrix2Xd j = Eigen::Matrix2Xd::Zero(2, static_cast<Eigen::Index>(parameters().values.size()));
    j(0, 0) = s * point.x();
    j(1, 1) = s * point.y();
    j(0, 2) = j(1, 3) = 1;
    if (!(r > 0)) return j;
    const auto by_values = curve_.radius_by_values(r, point.z());
    for (Eigen::Index k = 4; k < j.cols(); ++k) {
      const double by_value = by_values[static_cast<size_t>(k - 4)] / r;
      j(0, k) = fx_ * point.x() * by_value;
      j(1, k) = fy_ * point.y() * by_value;
    }
    return j;
  }

 private:
  static std::array<double, Curve::kValues> coefficients(const CameraParameters& parameters) {
    std::array<double, Curve::kValues> values{};
    std::copy(parameters.values.begin() + 4, parameters.values.end(), values.begin());
    return values;
  }
  /// The radius in the image over `r`. On the axis that is the slope.
  static double scale(const ImageRadius& radius, double r) { return r > 0 ? radius.value / r : radius.by_r; }

  [[nodiscard]] Eigen::Vector2d to_pixel(const Eigen::Vector3d& point, double s) const {
    return {fx_ * s * point.x() + cx_, fy_ * s * point.y() + cy_};
  }

  double fx_, fy_, cx_, cy_;
  Curve curve_;
};

}  // namespace

CameraPtr make_kannala_brandt(const CameraParameters& parameters) {
  return std::make_shared<const AxialCamera<KannalaBrandtCurve>>(parameters);
}

CameraPtr make_fov(const CameraParameters& parameters) {
  return std::make_shared<const AxialCamera<FovCurve>>(parameters);
}

}  // namespace cairn
