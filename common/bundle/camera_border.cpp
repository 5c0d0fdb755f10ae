// SPDX-License-Identifier: Apache-2.0
#include "common/bundle/camera_border.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace cairn {
namespace {

constexpr double kMinDiagonal = 1e-6;  ///< as SchurComplement's

using SlotMap = Eigen::Map<const Eigen::Matrix<double, kPoseSize, kPointSize>>;

Eigen::Index at(int camera) {
  return static_cast<Eigen::Index>(camera) * kIntrinsics;
}

}  // namespace

CameraBorder::CameraBorder(const std::vector<FreeCamera>& cameras, int poses, size_t points)
    : cameras_(cameras) {
  const auto columns = static_cast<Eigen::Index>(cameras.size()) * kIntrinsics;
  border_.resize(static_cast<Eigen::Index>(poses) * kPoseSize, columns);
  corner_.resize(columns, columns);
  gradient_.resize(columns);
  diagonal_.resize(columns);
  right_side_.resize(columns);
  coupling_.resize(kPointSize, columns);
  if (columns > 0) couplings_.resize(kPointSize, columns * static_cast<Eigen::Index>(points));
  step_.setZero(columns);
}

void CameraBorder::set_zero() {
  border_.setZero();
  corner_.setZero();
  gradient_.setZero();
  diagonal_.setZero();
  right_side_.setZero();
  coupling_.setZero();
}

void CameraBorder::add(const Share& share) {
  const Eigen::Index c = at(share.camera);
  const Eigen::Matrix2d wJtJ = share.weight * (share.J.transpose() * share.J);
  const Eigen::Matrix<double, kIntrinsics, kPointSize> wJA = share.weight * share.JA;
  corner_.block<kIntrinsics, kIntrinsics>(c, c) += wJtJ;
  diagonal_.segment<kIntrinsics>(c) += wJtJ.diagonal();
  gradient_.segment<kIntrinsics>(c) += share.weight * (share.J.transpose() * share.r);
  coupling_.middleCols<kIntrinsics>(c) += (wJA * share.rotation).transpose();
  if (share.column < 0) return;
  auto rows = border_.block<kPoseSize, kIntrinsics>(static_cast<Eigen::Index>(share.column) * kPoseSize, c);
  for (int i = 0; i < kIntrinsics; ++i) {
    const Eigen::Vector3d a = wJA.row(i);
    rows.col(i).head<3>() += a;
    rows.col(i).tail<3>() += share.x.cross(a);
  }
}

void CameraBorder::eliminate(size_t point, const Eigen::Vector3d& inverse_diagonal,
                             const Eigen::Vector3d& lower, const Eigen::Vector3d& y,
                             std::span<const double> Z, std::span<const int> columns) {
  coupling_.row(0) *= inverse_diagonal[0];
  coupling_.row(1) = (coupling_.row(1) - lower[0] * coupling_.row(0)) * inverse_diagonal[1];
  coupling_.row(2) =
      (coupling_.row(2) - lower[1] * coupling_.row(0) - lower[2] * coupling_.row(1)) * inverse_diagonal[2];
  for (size_t s = 0; s < columns.size(); ++s) {
    const SlotMap z(Z.data() + s * kSlotElements);
    border_.middleRows<kPoseSize>(static_cast<Eigen::Index>(columns[s]) * kPoseSize).noalias() -=
        z * coupling_;
  }
  corner_.noalias() -= coupling_.transpose() * coupling_;
  right_side_.noalias() -= coupling_.transpose() * y;
  couplings_.middleCols(static_cast<Eigen::Index>(point) * coupling_.cols(), coupling_.cols()) = coupling_;
  coupling_.setZero();
}

double CameraBorder::prior_cost(const std::vector<CameraPtr>& cameras, double squared_cutoff) const {
  double sum = 0;
  for (size_t i = 0; i < cameras_.size(); ++i)
    sum += cairn::prior_cost(cameras_[i], *cameras[i], squared_cutoff);
  return sum;
}

void CameraBorder::finish(const std::vector<CameraPtr>& cameras, double squared_cutoff, double lambda) {
  lambda_ = lambda;
  right_side_ += gradient_;
  for (size_t i = 0; i < cameras_.size(); ++i) {
    const Eigen::Index c = at(static_cast<int>(i));
    const PriorPull pull = prior_pull(cameras_[i], *cameras[i], squared_cutoff);
    corner_.diagonal().segment<kIntrinsics>(c) += pull.curvature;
    diagonal_.segment<kIntrinsics>(c) += pull.curvature;
    gradient_.segment<kIntrinsics>(c) += pull.gradient;
    right_side_.segment<kIntrinsics>(c) += pull.gradient;
  }
  diagonal_ = diagonal_.cwiseMax(kMinDiagonal);
  corner_.diagonal() += lambda * diagonal_;
}

Eigen::MatrixXd CameraBorder::solve_border(const ReducedSystem& factor) const {
  Eigen::MatrixXd solved(border_.rows(), border_.cols());
  for (Eigen::Index c = 0; c < border_.cols(); ++c) {
    Eigen::VectorXd column = border_.col(c);
    factor.solve(&column);
    solved.col(c) = column;
  }
  return solved;
}

void CameraBorder::solve(const ReducedSystem& factor, Eigen::VectorXd* poses) {
  const Eigen::MatrixXd solved = solve_border(factor);
  const Eigen::MatrixXd reduced = corner_ - border_.transpose() * solved;
  step_ = -reduced.llt().solve(right_side_ - border_.transpose() * *poses);
  *poses += solved * step_;
}

double CameraBorder::decrease() const {
  return lambda_ * step_.cwiseProduct(diagonal_).dot(step_) - gradient_.dot(step_);
}

Eigen::Vector3d CameraBorder::back_substitute(size_t point) const {
  return couplings_.middleCols(static_cast<Eigen::Index>(point) * step_.size(), step_.size()) * step_;
}

Eigen::MatrixXd CameraBorder::inverse_curvature(const ReducedSystem& factor) const {
  const Eigen::MatrixXd reduced = corner_ - border_.transpose() * solve_border(factor);
  return reduced.inverse();
}

}  // namespace cairn
