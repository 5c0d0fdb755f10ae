// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <ostream>
#include <string>

namespace cairn {
namespace {

struct NamedCamera {
  std::string name;
  CameraParameters parameters;
};

void PrintTo(const NamedCamera& camera, std::ostream* out) {
  *out << camera.name;
}

CameraParameters parameters_of(int width, int height, std::vector<double> values) {
  return {CameraModel::kPinholeRadtan, width, height, std::move(values)};
}

CameraPtr make(const CameraParameters& parameters) {
  auto camera = make_camera(parameters);
  EXPECT_TRUE(camera.has_value()) << (camera ? "" : camera.error().message);
  return camera.value();
}

class RealCameras : public testing::TestWithParam<NamedCamera> {
 protected:
  CameraPtr camera_ = make(GetParam().parameters);

  /// Calls `f` with a grid of pixels that covers the image to its very edge.
  template <typename F>
  void for_each_pixel(F f) const {
    constexpr int kSteps = 20;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; j <= kSteps; ++j) {
        f(Eigen::Vector2d(-0.5 + i * camera_->width() / static_cast<double>(kSteps),
                          -0.5 + j * camera_->height() / static_cast<double>(kSteps)));
      }
    }
  }
};

INSTANTIATE_TEST_SUITE_P(
    All, RealCameras,
    testing::Values(NamedCamera{"Pinhole", parameters_of(640, 480, {525, 525, 319.5, 239.5})},
                    NamedCamera{"EurocCam0", parameters_of(752, 480,
                                                           {458.654, 457.296, 367.215, 248.375, -0.28340811,
                                                            0.07395907, 0.00019359, 1.76187114e-05})},
                    NamedCamera{"TumFreiburg1", parameters_of(640, 480,
                                                              {517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531,
                                                               -0.0054, 0.0026, 1.1633})},
                    NamedCamera{
                        "BarrelWithK3",
                        parameters_of(640, 480, {420, 422, 315, 244, -0.32, 0.12, 1e-3, -8e-4, -0.02})},
                    NamedCamera{"Pincushion", parameters_of(384, 288, {380, 380, 190, 144, 0.11, 0.02})}),
    [](const auto& tested) { return tested.param.name; });

TEST_P(RealCameras, ProjectInvertsUnprojectOverTheWholeImage) {
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector3d ray = camera_->unproject(pixel);
    EXPECT_NEAR(ray.norm(), 1, 1e-14);
    const auto back = camera_->project(7.3 * ray);
    ASSERT_TRUE(back) << pixel.transpose();
    EXPECT_LT((*back - pixel).norm(), 1e-9) << pixel.transpose();
  });
}

TEST_P(RealCameras, PointJacobianMatchesDifferences) {
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    for (const double range : {0.3, 4.0}) {
      const Eigen::Vector3d point = range * camera_->unproject(pixel);
      Matrix23d analytic;
      const auto projected = camera_->project(point, &analytic);
      ASSERT_TRUE(projected);
      EXPECT_EQ(*projected, *camera_->project(point));
      Matrix23d numeric;
      const double step = 1e-6 * range;
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d d = step * Eigen::Vector3d::Unit(k);
        const auto plus = camera_->project(point + d);
        const auto minus = camera_->project(point - d);
        ASSERT_TRUE(plus && minus);
        numeric.col(k) = (*plus - *minus) / (2 * step);
      }
      EXPECT_LT((analytic - numeric).norm(), 1e-6 * analytic.norm()) << pixel.transpose();
    }
  });
}

TEST_P(RealCameras, ParameterJacobianMatchesDifferences) {
  const CameraParameters& parameters = camera_->parameters();
  for_each_pixel([&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector3d point = 2.0 * camera_->unproject(pixel);
    const Eigen::Matrix2Xd analytic = camera_->d_pixel_d_parameters(point);
    ASSERT_EQ(analytic.cols(), static_cast<Eigen::Index>(parameters.values.size()));
    for (size_t k = 0; k < parameters.values.size(); ++k) {
      const double step = 1e-6 * std::max(1.0, std::abs(parameters.values[k]));
      CameraParameters plus = parameters;
      CameraParameters minus = parameters;
      plus.values[k] += step;
      minus.values[k] -= step;
      const auto pixel_plus = make(plus)->project(point);
      const auto pixel_minus = make(minus)->project(point);
      ASSERT_TRUE(pixel_plus && pixel_minus);
      const Eigen::Vector2d numeric = (*pixel_plus - *pixel_minus) / (2 * step);
      EXPECT_LT((analytic.col(static_cast<Eigen::Index>(k)) - numeric).norm(), 1e-5) << "parameter " << k;
    }
  });
}

TEST(Camera, IsTheModelOfOpenCv) {
  // x = 0.3, y = -0.2: r^2 = 0.13; computed by hand from the documented formula.
  const auto camera = make(parameters_of(640, 480, {500, 510, 320, 240, -0.2, 0.1, 0.01, -0.02, 0.05}));
  const auto pixel = camera->project({0.6, -0.4, 2.0});
  ASSERT_TRUE(pixel);
  const double radial = 1 - 0.2 * 0.13 + 0.1 * 0.0169 + 0.05 * 0.002197;
  EXPECT_NEAR(pixel->x(), 320 + 500 * (0.3 * radial + 2 * 0.01 * -0.06 - 0.02 * (0.13 + 0.18)), 1e-10);
  EXPECT_NEAR(pixel->y(), 240 + 510 * (-0.2 * radial + 0.01 * (0.13 + 0.08) + 2 * -0.02 * -0.06), 1e-10);
}

TEST(Camera, PointsBehindDoNotProject) {
  const auto camera = make(parameters_of(640, 480, {525, 525, 319.5, 239.5}));
  EXPECT_FALSE(camera->project({0, 0, -1}));
  EXPECT_FALSE(camera->project({0.1, 0, 0}));
  EXPECT_FALSE(camera->project({0, 0, std::numeric_limits<double>::quiet_NaN()}));
}

TEST(Camera, PointsWhereTheDistortionFoldsBackDoNotProject) {
  // k1 alone: r (1 + k1 r^2) turns at r^2 = -1 / (3 k1) = 1.1905.
  const auto camera = make(parameters_of(640, 480, {400, 400, 320, 240, -0.28}));
  const double limit = std::sqrt(1 / (3 * 0.28));
  EXPECT_TRUE(camera->project({limit * 0.999, 0, 1}));
  EXPECT_FALSE(camera->project({limit * 1.001, 0, 1}));
  // A strong k3 turns a model that is monotonic without it.
  const auto with_k3 = make(parameters_of(640, 480, {400, 400, 320, 240, 0.0, 0.0, 0, 0, -0.1}));
  const double limit_k3 = std::pow(1 / 0.7, 1.0 / 6);
  EXPECT_TRUE(with_k3->project({0, limit_k3 * 0.999, 1}));
  EXPECT_FALSE(with_k3->project({0, limit_k3 * 1.001, 1}));
}

TEST(Camera, PixelsThatNoRayReachesUnprojectToTheRim) {
  const auto camera = make(parameters_of(2000, 2000, {400, 400, 1000, 1000, -0.28}));
  const Eigen::Vector3d ray = camera->unproject({0, 0});
  ASSERT_TRUE(ray.allFinite());
  EXPECT_NEAR(ray.head<2>().norm() / ray.z(), std::sqrt(1 / (3 * 0.28)), 1e-4);
}

TEST(Camera, InImageRespectsTheBorder) {
  const auto camera = make(parameters_of(640, 480, {525, 525, 319.5, 239.5}));
  EXPECT_TRUE(camera->in_image({0, 0}));
  EXPECT_TRUE(camera->in_image({639, 479}));
  EXPECT_FALSE(camera->in_image({639.1, 479}));
  EXPECT_FALSE(camera->in_image({9.9, 200}, 10));
}

TEST(Camera, WrongParametersAreRefusedWithAReason) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& wrong :
       {parameters_of(640, 480, {525, 525, 319}),
        parameters_of(640, 480, {525, 525, 319, 239, 0, 0, 0, 0, 0, 0}),
        parameters_of(640, 480, {-525, 525, 319, 239}), parameters_of(640, 480, {525, nan, 319, 239}),
        parameters_of(0, 480, {525, 525, 319, 239}), parameters_of(640, -1, {525, 525, 319, 239}),
        CameraParameters{static_cast<CameraModel>(77), 640, 480, {525, 525, 319, 239}}}) {
    const auto camera = make_camera(wrong);
    ASSERT_FALSE(camera);
    EXPECT_EQ(camera.error().code, ErrorCode::kConfiguration);
    EXPECT_FALSE(camera.error().message.empty());
  }
}

}  // namespace
}  // namespace cairn
