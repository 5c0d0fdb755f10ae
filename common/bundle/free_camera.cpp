// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/free_camera.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/camera_guess.h"
#include "common/geometry/robust.h"

namespace cairn {
namespace {

constexpr size_t kFx = 0;
constexpr size_t kFy = 1;
constexpr size_t kK1 = 4;

}  // namespace

Intrinsics intrinsics_of(const Camera& camera) {
  const auto& values = camera.parameters().values;
  return {std::log(values[kFx]), values.size() > kK1 ? values[kK1] : 0.0};
}

CameraPtr with_intrinsics(const Camera& camera, const Intrinsics& intrinsics) {
  CameraParameters parameters = camera.parameters();
  auto& values = parameters.values;
  values.resize(std::max(values.size(), kK1 + 1), 0.0);
  const double aspect = values[kFy] / values[kFx];
  values[kFx] = std::exp(intrinsics[0]);
  values[kFy] = aspect * values[kFx];
  values[kK1] = intrinsics[1];
  if (!is_focal_length(values[kFx], parameters.width, parameters.height)) return nullptr;
  return make_camera(parameters).value_or(nullptr);
}

Eigen::Matrix<double, 2, kIntrinsics> d_pixel_d_intrinsics(const Camera& camera,
                                                           const Eigen::Vector3d& point) {
  const Eigen::Matrix2Xd all = camera.d_pixel_d_parameters(point);
  const auto& values = camera.parameters().values;
  Eigen::Matrix<double, 2, kIntrinsics> result;
  result.col(0) = all.col(kFx) * values[kFx] + all.col(kFy) * values[kFy];
  result.col(1) = all.col(kK1);
  return result;
}

Intrinsics within_reach(const FreeCamera& prior, const Intrinsics& intrinsics) {
  const Intrinsics reach = kPriorReach * prior.prior_sigma;
  return intrinsics.cwiseMax(prior.prior_mean - reach).cwiseMin(prior.prior_mean + reach);
}

bool is_held_by_prior(const FreeCamera& camera) {
  constexpr double kNear = 0.9;  // of the prior's reach
  const Intrinsics away =
      (intrinsics_of(*camera.camera) - camera.prior_mean).cwiseQuotient(camera.prior_sigma);
  return away.cwiseAbs().maxCoeff() >= kNear * kPriorReach;
}

double noise_variance(double squared_cutoff) {
  constexpr double kCutoffPerLength = kTukeyCutoffPerSigma * kDeviationPerMedian;
  constexpr double kMedianPerVariance = 1.386;  // of chi^2 with two degrees of freedom
  return squared_cutoff / (kCutoffPerLength * kCutoffPerLength * kMedianPerVariance);
}

double prior_cost(const FreeCamera& prior, const Camera& camera, double squared_cutoff) {
  const Intrinsics values = intrinsics_of(camera);
  const Intrinsics away = (values - prior.prior_mean).cwiseQuotient(prior.prior_sigma);
  const Intrinsics beyond = (values - within_reach(prior, values)).cwiseQuotient(prior.prior_sigma);
  return 0.5 * noise_variance(squared_cutoff) * (away.squaredNorm() + kWall * beyond.squaredNorm());
}

PriorPull prior_pull(const FreeCamera& prior, const Camera& camera, double squared_cutoff) {
  const Intrinsics values = intrinsics_of(camera);
  const Intrinsics beyond = values - within_reach(prior, values);
  const Intrinsics information =
      noise_variance(squared_cutoff) * prior.prior_sigma.cwiseAbs2().cwiseInverse();
  PriorPull pull{information.cwiseProduct(values - prior.prior_mean + kWall * beyond), information};
  for (int i = 0; i < kIntrinsics; ++i) {
    if (beyond[i] != 0) pull.curvature[i] *= 1 + kWall;
  }
  return pull;
}

double largest_move(const Camera& from, const Camera& to) {
  constexpr int kSteps = 4;  // along each side
  double largest = 0;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      if (i % kSteps != 0 && j % kSteps != 0) continue;
      const Eigen::Vector2d pixel(i * (from.width() - 1.0) / kSteps, j * (from.height() - 1.0) / kSteps);
      const auto moved = to.project(from.unproject(pixel));
      if (moved) largest = std::max(largest, (*moved - pixel).norm());
    }
  }
  return largest;
}

}  // namespace cairn
