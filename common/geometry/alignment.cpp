// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/alignment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

namespace cairn {
namespace {

using PointMatrix = Eigen::Map<const Eigen::Matrix3Xd>;

/// Whether points spread in at least two directions: otherwise a rotation about their line is free.
bool spans_a_plane(const PointMatrix& points) {
  const Eigen::Vector3d mean = points.rowwise().mean();
  const Eigen::Matrix3Xd centred = points.colwise() - mean;
  const Eigen::Matrix3d scatter = centred * centred.transpose();
  const Eigen::Vector3d values =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter, Eigen::EigenvaluesOnly).eigenvalues();
  // Squared lengths: 1e-12 is one part in a million of the extent. Coordinates far from the origin add
  // rounding noise.
  const double rounding = 1e-28 * mean.squaredNorm() * static_cast<double>(points.cols());
  return values(1) > 1e-12 * values(2) + rounding && values(2) > 0;
}

}  // namespace

Result<Similarity3> align_points(std::span<const Eigen::Vector3d> from, std::span<const Eigen::Vector3d> to,
                                 bool with_scale) {
  if (from.size() != to.size())
    return fail(ErrorCode::kInternal, "alignment: the two lists differ in length");
  if (from.size() < 3) return fail(ErrorCode::kDegenerate, "alignment: fewer than 3 points");
  const auto n = static_cast<Eigen::Index>(from.size());
  const PointMatrix source(from.front().data(), 3, n);
  const PointMatrix target(to.front().data(), 3, n);
  if (!source.allFinite() || !target.allFinite())
    return fail(ErrorCode::kDegenerate, "alignment: a point is not finite");
  if (!spans_a_plane(source) || !spans_a_plane(target)) {
    return fail(ErrorCode::kDegenerate, "alignment: the points lie on one line or in one place");
  }
  const Eigen::Matrix4d m = Eigen::umeyama(source, target, with_scale);
  const double scale = with_scale ? std::cbrt(m.topLeftCorner<3, 3>().determinant()) : 1.0;
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>() / scale;
  return Similarity3(scale, Eigen::Quaterniond(rotation), m.topRightCorner<3, 1>());
}

}  // namespace cairn
