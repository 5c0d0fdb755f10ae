// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibrate/board_pose.h"

#include <Eigen/Dense>

namespace cairn {
namespace {

constexpr double kMinCosine = 0.05;  ///< rays flatter than this say nothing in a homography

/// Takes the points to mean 0 and mean distance 1 (for the conditioning of the linear system).
Eigen::Matrix3d centred(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : points) mean += p.head<2>();
  mean /= static_cast<double>(points.size());
  double distance = 0;
  for (const auto& p : points) distance += (p.head<2>() - mean).norm();
  const double scale = distance > 0 ? static_cast<double>(points.size()) / distance : 1;
  Eigen::Matrix3d transform;
  transform << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
  return transform;
}

}  // namespace

std::optional<Eigen::Matrix3d> board_homography(const std::vector<Eigen::Vector3d>& on_board,
                                                const std::vector<Eigen::Vector3d>& directions) {
  if (on_board.size() < 4 || on_board.size() != directions.size()) return std::nullopt;
  const Eigen::Matrix3d centre = centred(on_board);
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (size_t i = 0; i < on_board.size(); ++i) {
    const Eigen::Vector3d p = centre * on_board[i].head<2>().homogeneous();
    const Eigen::Matrix3d across = skew(directions[i].normalized());  // direction x (H p) = 0
    Eigen::Matrix<double, 3, 9> rows;
    rows << across * p.x(), across * p.y(), across * p.z();  // H column by column
    normal.noalias() += rows.transpose() * rows;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> solver(normal);
  constexpr double kMinSecond = 1e-9;  // of the largest: else a whole family of homographies fits
  if (solver.eigenvalues()(1) < kMinSecond * solver.eigenvalues()(8)) return std::nullopt;
  const Eigen::Matrix3d h = Eigen::Map<const Eigen::Matrix3d>(solver.eigenvectors().col(0).data());
  return h * centre;
}

std::optional<SE3> board_pose(const Camera& camera, const BoardView& view) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> rays;
  for (size_t i = 0; i < view.size(); ++i) {
    const Eigen::Vector3d ray = camera.unproject(view.pixels[i]);
    if (ray.z() < kMinCosine) continue;
    points.push_back(view.on_board[i]);
    rays.push_back(ray);
  }
  auto h = board_homography(points, rays);
  if (!h) return std::nullopt;
  // H ~ [r1 r2 t]; its sign puts the board where the rays go.
  double ahead = 0;
  for (size_t i = 0; i < points.size(); ++i) ahead += rays[i].dot(*h * points[i].head<2>().homogeneous());
  const double scale = 0.5 * (h->col(0).norm() + h->col(1).norm()) * (ahead < 0 ? -1 : 1);
  *h /= scale;
  Eigen::Matrix3d axes;
  axes << h->col(0), h->col(1), h->col(0).cross(h->col(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(axes, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d rotation = svd.matrixU() * svd.matrixV().transpose();
  if (!(rotation.determinant() > 0)) return std::nullopt;
  const SE3 pose(rotation, h->col(2));
  return pose.is_finite() ? std::optional<SE3>(pose) : std::nullopt;
}

}  // namespace cairn
