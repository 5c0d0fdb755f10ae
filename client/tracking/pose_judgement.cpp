// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/pose_judgement.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

namespace cairn {
namespace {

/// Standard deviation in the direction that a matrix has least information of.
double worst_sigma(const Eigen::Matrix3d& information) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(information, Eigen::EigenvaluesOnly);
  const double least = solver.eigenvalues()[0];
  return least > 0 ? 1 / std::sqrt(least) : std::numeric_limits<double>::infinity();
}

}  // namespace

PoseJudgement judge_pose(const Matrix6d& information, double mean_depth,
                         const PoseJudgementOptions& options) {
  PoseJudgement judgement;
  const Eigen::Matrix3d of_rotation = information.bottomRightCorner<3, 3>();
  judgement.position_sigma = std::numeric_limits<double>::infinity();
  judgement.rotation_sigma = worst_sigma(of_rotation);
  if (!(judgement.rotation_sigma < options.known_rotation)) return judgement;
  judgement.support = PoseSupport::kRotation;
  // What is left for the position once the rotation is whatever fits best.
  const Eigen::Matrix3d across = information.topRightCorner<3, 3>();
  const Eigen::Matrix3d of_position =
      information.topLeftCorner<3, 3>() - across * of_rotation.ldlt().solve(across.transpose());
  judgement.position_sigma = worst_sigma(of_position) / mean_depth;
  if (judgement.position_sigma < options.known_position) judgement.support = PoseSupport::kPosition;
  return judgement;
}

}  // namespace cairn
