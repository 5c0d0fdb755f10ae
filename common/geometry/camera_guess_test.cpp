// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/camera_guess.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cairn {
namespace {

TEST(CameraGuess, SixtyDegreesAlongTheLongerSide) {
  for (const ImageSize size : {ImageSize{640, 480}, ImageSize{480, 640}, ImageSize{1920, 1080}}) {
    const IntrinsicsPrior guess = guess_camera(size);
    const auto camera = make_camera(guess.parameters);
    ASSERT_TRUE(camera);
    const Eigen::Vector2d middle(0.5 * (size.width - 1), 0.5 * (size.height - 1));
    const Eigen::Vector2d half_side = size.width > size.height ? Eigen::Vector2d(0.5 * size.width, 0)
                                                               : Eigen::Vector2d(0, 0.5 * size.height);
    const Eigen::Vector3d axis = (*camera)->unproject(middle).normalized();
    const Eigen::Vector3d side = (*camera)->unproject(middle + half_side).normalized();
    EXPECT_NEAR(std::acos(axis.dot(side)), std::acos(-1.0) / 6, 1e-6);
  }
}

TEST(CameraGuess, WhatTheWireSaysOfItComesBack) {
  const IntrinsicsPrior guess = guess_camera({640, 480});
  const auto back = intrinsics_prior(guess.parameters, sigma_of_values(guess));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->parameters, guess.parameters);
  EXPECT_NEAR(back->focal_sigma, guess.focal_sigma, 1e-12);
  EXPECT_EQ(back->k1_sigma, guess.k1_sigma);
}

TEST(CameraGuess, NoPriorIsMadeOfWhatCouldBeNoCamera) {
  const IntrinsicsPrior guess = guess_camera({640, 480});
  const std::vector<double> sigma = sigma_of_values(guess);
  const auto refuses = [&](const char* what, const auto& spoil) {
    CameraParameters parameters = guess.parameters;
    std::vector<double> spoilt = sigma;
    spoil(&parameters, &spoilt);
    EXPECT_FALSE(intrinsics_prior(parameters, spoilt)) << what;
  };
  using Values = std::vector<double>;
  for (const double focal : {1e-300, 1.0, 1e5, 1e300}) {
    refuses("absurd focal length", [&](CameraParameters* p, Values* s) {
      for (const size_t i : {0, 1}) {
        (*s)[i] *= focal / p->values[i];
        p->values[i] = focal;
      }
    });
  }
  refuses("one focal length of many", [](CameraParameters* p, Values*) { p->values[1] *= 1e6; });
  refuses("no sigma", [](CameraParameters*, Values* s) { s->clear(); });
  refuses("sigma of nothing", [](CameraParameters*, Values* s) { (*s)[0] = (*s)[4] = 0; });
  refuses("sigma that is no number",
          [](CameraParameters*, Values* s) { (*s)[0] = std::numeric_limits<double>::quiet_NaN(); });
  refuses("sigma as large as anything", [](CameraParameters*, Values* s) { (*s)[4] = 1e9; });
  refuses("too few values", [](CameraParameters* p, Values* s) {
    p->values.resize(5);
    s->resize(5);
  });
  refuses("another model", [](CameraParameters* p, Values*) { p->model = CameraModel::kKannalaBrandt; });
}

TEST(CameraGuess, ARoughCalibrationIsBelievedRoughly) {
  const CameraParameters rough{CameraModel::kPinholeRadtan, 640, 480, {500, 501, 320, 240}};
  const auto prior = rough_prior(rough);
  ASSERT_TRUE(prior);
  EXPECT_TRUE(intrinsics_prior(prior->parameters, sigma_of_values(*prior))) << "as the wire says it";
  EXPECT_EQ(prior->parameters.values[0], 500);
  EXPECT_FALSE(rough_prior({CameraModel::kFov, 640, 480, {500, 500, 320, 240, 0.9}}));
}

TEST(CameraGuess, ACalibrationWithoutDistortionIsNominal) {
  const std::vector<double> pinhole = {500, 501, 320, 240};
  for (const size_t values : {size_t{4}, size_t{8}, kPriorValues}) {
    CameraParameters parameters{CameraModel::kPinholeRadtan, 640, 480, pinhole};
    parameters.values.resize(values, 0.0);
    const auto nominal = nominal_camera(parameters);
    ASSERT_TRUE(nominal) << values << " values";
    EXPECT_TRUE(intrinsics_prior(nominal->parameters, sigma_of_values(*nominal))) << "as the wire says it";
    EXPECT_LT(nominal->focal_sigma, rough_prior(parameters)->focal_sigma);
    for (size_t term = pinhole.size(); term < values; ++term) {
      CameraParameters distorted = parameters;
      distorted.values[term] = -1e-4;
      EXPECT_FALSE(nominal_camera(distorted)) << "term " << term;
    }
  }
  EXPECT_FALSE(nominal_camera({CameraModel::kKannalaBrandt, 640, 480, {500, 501, 320, 240, 0, 0, 0, 0}}));
}

}  // namespace
}  // namespace cairn
