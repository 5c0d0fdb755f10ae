// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
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

/// TUM-VI's camera 0 (Kalibr), whose field of view in the image's corners is beyond 90 degrees off the
/// axis.
const CameraParameters kTumVi{
    CameraModel::kKannalaBrandt,
    512,
    512,
    {190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504, 0.0034823894022493434,
     0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182}};
/// A phone lens of little distortion.
const CameraParameters kNarrowFisheye{
    CameraModel::kKannalaBrandt, 640, 480, {500, 502, 318, 243, -0.05, 0.02, -0.03, 0.01}};
/// PTAM's default camera.cfg for 640x480.
const CameraParameters kPtam{
    CameraModel::kFov, 640, 480, {0.738 * 640, 1.0112 * 480, 0.4996 * 640 - 0.5, 0.51 * 480 - 0.5, 0.1794}};
/// TUM monoVO's wide lens.
const CameraParameters kMonoVo{CameraModel::kFov, 1280, 1024, {457, 456, 640, 512, 0.93}};

CameraPtr make(const CameraParameters& parameters) {
  auto camera = make_camera(parameters);
  EXPECT_TRUE(camera.has_value()) << (camera ? "" : camera.error().message);
  return camera.value();
}

class RealCameras : public ::testing::TestWithParam<NamedCamera> {
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
    ::testing::Values(NamedCamera{"Pinhole", parameters_of(640, 480, {525, 525, 319.5, 239.5})},
                      NamedCamera{"EurocCam0", parameters_of(752, 480,
                                                             {458.654, 457.296, 367.215, 248.375, -0.28340811,
                                                              0.07395907, 0.00019359, 1.76187114e-05})},
                      NamedCamera{"TumFreiburg1", parameters_of(640, 480,
                                                                {517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531,
                                                                 -0.0054, 0.0026, 1.1633})},
                      NamedCamera{
                          "BarrelWithK3",
                          parameters_of(640, 480, {420, 422, 315, 244, -0.32, 0.12, 1e-3, -8e-4, -0.02})},
                      NamedCamera{"Pincushion", parameters_of(384, 288, {380, 380, 190, 144, 0.11, 0.02})},
                      NamedCamera{"TumVi", kTumVi}, NamedCamera{"NarrowFisheye", kNarrowFisheye},
                      NamedCamera{"Ptam", kPtam}, NamedCamera{"MonoVo", kMonoVo}),
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

/// Points all around the axis at the angle theta [rad] from it, at several distances.
template <typename F>
void for_each_point_at(double theta, F f) {
  for (int i = 0; i < 12; ++i) {
    const double around = 0.1 + i * std::numbers::pi / 6;
    for (const double range : {1e-3, 1.0, 250.0}) {
      f(range * Eigen::Vector3d(std::sin(theta) * std::cos(around), std::sin(theta) * std::sin(around),
                                std::cos(theta)));
    }
  }
}

double degrees(double angle) {
  return angle * std::numbers::pi / 180;
}

class WideCameras : public ::testing::TestWithParam<NamedCamera> {};

INSTANTIATE_TEST_SUITE_P(All, WideCameras,
                         ::testing::Values(NamedCamera{"TumVi", kTumVi},
                                           NamedCamera{
                                               "Equidistant",
                                               {CameraModel::kKannalaBrandt, 800, 800, {150, 151, 400, 401}}},
                                           NamedCamera{"Fov", kMonoVo}),
                         [](const auto& tested) { return tested.param.name; });

TEST_P(WideCameras, RoundTripsAndJacobiansHoldBehindTheImagePlane) {
  const auto camera = make(GetParam().parameters);
  for (const double off_axis : {1e-7, 0.01, 30.0, 89.0, 90.0, 91.0, 105.0}) {
    for_each_point_at(degrees(off_axis), [&](const Eigen::Vector3d& point) {
      Matrix23d analytic;
      const auto pixel = camera->project(point, &analytic);
      ASSERT_TRUE(pixel) << off_axis;
      EXPECT_EQ(*pixel, *camera->project(point));
      EXPECT_LT((camera->unproject(*pixel) - point.normalized()).norm(), 1e-9) << off_axis;
      const double step = 1e-6 * point.norm();
      Matrix23d numeric;
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d d = step * Eigen::Vector3d::Unit(k);
        numeric.col(k) = (*camera->project(point + d) - *camera->project(point - d)) / (2 * step);
      }
      EXPECT_LT((analytic - numeric).norm(), 1e-6 * analytic.norm()) << off_axis;
    });
  }
}

TEST(KannalaBrandt, WithoutDistortionIsEquidistant) {
  const auto camera = make({CameraModel::kKannalaBrandt, 800, 800, {150, 160, 400, 401, 0, 0, 0, 0}});
  for (const double off_axis : {0.0, 5.0, 60.0, 90.0, 120.0, 179.0}) {
    for_each_point_at(degrees(off_axis), [&](const Eigen::Vector3d& point) {
      const auto pixel = camera->project(point);
      ASSERT_TRUE(pixel);
      const Eigen::Vector2d m((pixel->x() - 400) / 150, (pixel->y() - 401) / 160);
      EXPECT_NEAR(m.norm(), degrees(off_axis), 1e-12);
      EXPECT_NEAR(m.x() * point.y() - m.y() * point.x(), 0, 1e-10 * point.norm());
    });
  }
}

TEST(KannalaBrandt, IsTheModelOfOpenCvsFisheye) {
  // cv::fisheye::projectPoints of (0.6, -0.4, 0.5), by the documented formula.
  const auto camera =
      make({CameraModel::kKannalaBrandt, 640, 480, {300, 310, 320, 240, 0.02, -0.01, 0.003, -0.0004}});
  const double r = std::hypot(0.6, 0.4) / 0.5;
  const double theta = std::atan(r);
  const double bent = theta * (1 + 0.02 * std::pow(theta, 2) - 0.01 * std::pow(theta, 4) +
                               0.003 * std::pow(theta, 6) - 0.0004 * std::pow(theta, 8));
  const auto pixel = camera->project({0.6, -0.4, 0.5});
  ASSERT_TRUE(pixel);
  EXPECT_NEAR(pixel->x(), 320 + 300 * bent / r * 1.2, 1e-10);
  EXPECT_NEAR(pixel->y(), 240 - 310 * bent / r * 0.8, 1e-10);
}

TEST(KannalaBrandt, EndsWhereItFoldsBackAndOnTheAxisBehind) {
  // k1 alone: theta + k1 theta^3 turns at theta^2 = -1 / (3 k1).
  const auto folding = make({CameraModel::kKannalaBrandt, 800, 800, {200, 200, 400, 400, -0.1}});
  const double limit = std::sqrt(1 / 0.3);  // 104.6 degrees
  for_each_point_at(limit - 1e-6, [&](const auto& point) { EXPECT_TRUE(folding->project(point)); });
  for_each_point_at(limit + 1e-6, [&](const auto& point) { EXPECT_FALSE(folding->project(point)); });
  const Eigen::Vector3d rim = folding->unproject({-4000, 400});
  EXPECT_NEAR(std::atan2(rim.head<2>().norm(), rim.z()), limit, 1e-6);
  EXPECT_LT(rim.x(), 0);
  const auto camera = make({CameraModel::kKannalaBrandt, 800, 800, {200, 200, 400, 400}});
  EXPECT_FALSE(camera->project({0, 0, -1}));
  EXPECT_TRUE(camera->project({0, 1e-9, -1}));
}

TEST(Fov, GoesToThePinholeAsWGoesToZero) {
  const auto pinhole = make({CameraModel::kPinholeRadtan, 640, 480, {500, 505, 320, 240}});
  const auto zero = make({CameraModel::kFov, 640, 480, {500, 505, 320, 240, 0}});
  for (const double off_axis : {0.0, 1.0, 30.0, 60.0}) {
    for_each_point_at(degrees(off_axis), [&](const Eigen::Vector3d& point) {
      Matrix23d expected;
      Matrix23d actual;
      const Eigen::Vector2d pixel = *pinhole->project(point, &expected);
      EXPECT_LT((*zero->project(point, &actual) - pixel).norm(), 1e-9);
      EXPECT_LT((actual - expected).norm(), 1e-9 * expected.norm());
      // The first term in w^2 (series of atan(2 r tan(w/2)) / w) halves its error twice with every halving of
      // w.
      const double x = point.head<2>().norm() / point.z();
      for (const double w : {1e-8, 1e-4, 1e-3, 1e-2}) {
        const auto camera = make({CameraModel::kFov, 640, 480, {500, 505, 320, 240, w}});
        const double bound = 505 * w * w * (x / 12 + x * x * x / 3) + 1e-9;
        EXPECT_LE((*camera->project(point) - pixel).norm(), 1.01 * bound) << w;
        EXPECT_LT((camera->unproject(*camera->project(point)) - point.normalized()).norm(), 1e-9) << w;
      }
    });
  }
  EXPECT_FALSE(zero->project({0.1, 0.1, 0}));
  EXPECT_FALSE(zero->project({0, 0, -1}));
  EXPECT_LT((zero->unproject({400, 300}) - pinhole->unproject({400, 300})).norm(), 1e-12);
}

TEST(Fov, ParameterJacobianHoldsForSmallW) {
  const Eigen::Vector3d point(0.4, -0.7, 1.1);
  for (const double w : {2e-5, 9.9e-4, 1.01e-3, 0.02, 2.5}) {
    const auto at = [&](double value) {
      return *make({CameraModel::kFov, 640, 480, {500, 505, 320, 240, value}})->project(point);
    };
    const double step = 1e-5;
    const Eigen::Vector2d numeric = (at(w + step) - at(w - step)) / (2 * step);
    const auto camera = make({CameraModel::kFov, 640, 480, {500, 505, 320, 240, w}});
    EXPECT_LT((camera->d_pixel_d_parameters(point).col(4) - numeric).norm(), 1e-5) << w;
  }
}

TEST(AxialCameras, TheCentreAndNonsenseDoNotProject) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& parameters : {kTumVi, kNarrowFisheye, kPtam, kMonoVo}) {
    const auto camera = make(parameters);
    Matrix23d jacobian;
    for (const Eigen::Vector3d& point : {Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0, 0, -1),
                                         Eigen::Vector3d(nan, 0, 1), Eigen::Vector3d(0, 0, nan)}) {
      EXPECT_FALSE(camera->project(point)) << point.transpose();
      EXPECT_FALSE(camera->project(point, &jacobian)) << point.transpose();
    }
    const auto axis = camera->project({0, 0, 2}, &jacobian);
    ASSERT_TRUE(axis);
    EXPECT_TRUE(jacobian.allFinite());
    EXPECT_LT((camera->unproject(*axis) - Eigen::Vector3d::UnitZ()).norm(), 1e-12);
    EXPECT_TRUE(camera->d_pixel_d_parameters({0, 0, 2}).allFinite());
  }
}

TEST(CameraModel, NamesAreDistinct) {
  EXPECT_EQ(name_of(CameraModel::kPinholeRadtan), "pinhole-radtan");
  EXPECT_EQ(name_of(CameraModel::kKannalaBrandt), "kb4");
  EXPECT_EQ(name_of(CameraModel::kFov), "fov");
  EXPECT_EQ(name_of(static_cast<CameraModel>(77)), "unknown");
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
        CameraParameters{CameraModel::kKannalaBrandt, 640, 480, {525, 525, 319, 239, 0, 0, 0, 0, 0}},
        CameraParameters{CameraModel::kFov, 640, 480, {525, 525, 319, 239}},
        CameraParameters{CameraModel::kFov, 640, 480, {525, 525, 319, 239, -0.1}},
        CameraParameters{CameraModel::kFov, 640, 480, {525, 525, 319, 239, 3.2}},
        CameraParameters{static_cast<CameraModel>(77), 640, 480, {525, 525, 319, 239}}}) {
    const auto camera = make_camera(wrong);
    ASSERT_FALSE(camera);
    EXPECT_EQ(camera.error().code, ErrorCode::kConfiguration);
    EXPECT_FALSE(camera.error().message.empty());
  }
}

}  // namespace
}  // namespace cairn
