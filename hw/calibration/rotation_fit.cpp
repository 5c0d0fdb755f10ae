// SPDX-License-Identifier: Apache-2.0
#include "hw/calibration/rotation_fit.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace cairn {

RotationFit fit_rotation(std::span<const VectorPair> pairs) {
  const auto count = static_cast<double>(pairs.size());
  Eigen::Vector3d from = Eigen::Vector3d::Zero();
  Eigen::Vector3d to = Eigen::Vector3d::Zero();
  for (const VectorPair& pair : pairs) {
    from += pair.from / count;
    to += pair.to / count;
  }
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const VectorPair& pair : pairs) {
    moments += (pair.to - to) * (pair.from - from).transpose();
    spread += (pair.from - from) * (pair.from - from).transpose() / count;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(moments, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  signs.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;  // no mirror
  const Eigen::Matrix3d rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  RotationFit fit{Eigen::Quaterniond(rotation), to - rotation * from};
  for (const VectorPair& pair : pairs)
    fit.residual += (pair.to - rotation * pair.from - fit.offset).squaredNorm();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> main(spread, Eigen::EigenvaluesOnly);
  fit.about = std::sqrt(std::max(0.0, main.eigenvalues()[1]));
  return fit;
}

}  // namespace cairn
