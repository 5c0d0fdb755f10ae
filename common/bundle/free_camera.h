// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "common/geometry/camera.h"

/// What self-calibration in a map finds of a camera of which little is known: its focal length and one term
/// of distortion.
namespace cairn {

constexpr int kIntrinsics = 2;
/// Logarithm of fx [px] (fy/fx is kept), and k1. The logarithm, since what is not known is a factor.
using Intrinsics = Eigen::Matrix<double, kIntrinsics, 1>;

/// The intrinsics of a pinhole-radtan camera; a k1 that it does not have is 0.
[[nodiscard]] Intrinsics intrinsics_of(const Camera& camera);
/// The camera with other intrinsics; null when they make none (is_focal_length()).
[[nodiscard]] CameraPtr with_intrinsics(const Camera& camera, const Intrinsics& intrinsics);
/// d pixel / d intrinsics [px] at a point in camera coordinates that projects.
[[nodiscard]] Eigen::Matrix<double, 2, kIntrinsics> d_pixel_d_intrinsics(const Camera& camera,
                                                                         const Eigen::Vector3d& point);

/// Largest move [px] of a pixel of the image's border and corners, for rays that both cameras see.
[[nodiscard]] double largest_move(const Camera& from, const Camera& to);

/// A prior is a normal distribution that all but ends at kPriorReach sigma: what lies beyond costs kWall
/// times as much, or thousands of residuals that are no independent noise would drag the values anywhere.
constexpr double kPriorReach = 3;
constexpr double kWall = 1e4;

/// A camera in a bundle problem whose intrinsics are adjusted too.
struct FreeCamera {
  CameraPtr camera;  ///< pinhole-radtan; the present values
  Intrinsics prior_mean = Intrinsics::Zero();
  Intrinsics prior_sigma = Intrinsics::Ones();
  /// Covariance of the adjusted intrinsics, from noise as large as the residuals say and from the prior.
  /// find_cameras() adds what these do not tell.
  Eigen::Matrix<double, kIntrinsics, kIntrinsics> covariance = Eigen::Matrix2d::Zero();
  /// Whether find_cameras() tries other focal lengths and judges the covariance; else that stays. After it:
  /// whether the covariance was judged.
  bool judge = true;
};

/// The intrinsics, each value clamped to kPriorReach sigma about the prior's mean.
[[nodiscard]] Intrinsics within_reach(const FreeCamera& prior, const Intrinsics& intrinsics);
/// Whether the prior holds the present values, near where it ends: they say nothing then.
[[nodiscard]] bool is_held_by_prior(const FreeCamera& camera);
/// Gradient and (diagonal) curvature of prior_cost() at some intrinsics.
struct PriorPull {
  Intrinsics gradient;
  Intrinsics curvature;
};
[[nodiscard]] PriorPull prior_pull(const FreeCamera& prior, const Camera& camera, double squared_cutoff);

/// Variance of a component of a whitened residual, by the squared cut-off that the median of their lengths
/// gave (tukey_squared_cutoff()).
[[nodiscard]] double noise_variance(double squared_cutoff);

/// What intrinsics that differ from the prior add to the robust cost of a bundle problem.
[[nodiscard]] double prior_cost(const FreeCamera& prior, const Camera& camera, double squared_cutoff);

}  // namespace cairn
