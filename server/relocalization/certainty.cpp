// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/certainty.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "server/relocalization/image_cells.h"
#include "server/relocalization/map_agreement.h"

namespace cairn {
namespace {

/// Support of a pose: the sum of the Tukey weights of all that it explains.
double support_of(const PoseEstimate& pose) {
  return std::accumulate(pose.weights.begin(), pose.weights.end(), 0.0);
}

std::vector<SE3> poses_aside(const SE3& camera_from_map, double depth, double by) {
  const Eigen::Vector3d pivot(0, 0, depth);
  std::vector<SE3> poses;
  for (const double way : {by, -by}) {
    for (const int axis : {0, 1}) {
      const Eigen::Quaterniond turn(Eigen::AngleAxisd(way, Eigen::Vector3d::Unit(axis)));
      poses.push_back(SE3(turn, pivot - turn * pivot) * camera_from_map);
    }
    poses.push_back(SE3(Eigen::Quaterniond::Identity(), way * pivot) * camera_from_map);
  }
  return poses;
}

/// Some of the points around a pose, by which others are compared with it for a small part of what refining
/// each would cost.
class Sample {
 public:
  Sample(const PlaceView& view, const CornerGrid& grid, const Camera& camera, const ProjectedPoints& around,
         const SettleOptions& options, const MatchOptions& matching)
      : view_(view), grid_(grid), camera_(camera), options_(options), matching_(matching) {
    seen_.sightings = around.sightings;
    const size_t count = std::min<size_t>(options.sampled, around.points.size());
    for (size_t i = 0; i < count; ++i) sample_.push_back(around.points[i * around.points.size() / count]);
  }

  /// The pose that is found from there; nothing: the points found do not determine it.
  [[nodiscard]] std::optional<PoseEstimate> look_from(const SE3& start) {
    PoseEstimate pose = as_certain(start);
    for (const double radius : options_.radii) {
      project(pose.camera_from_map);
      PoseOptions options;
      options.fixed_cutoff_after = 0;
      options.late_squared_cutoff = radius * radius;
      const auto matches = match_near(view_, grid_, seen_, radius, matching_).matches;
      auto next = optimize_pose(camera_, pose.camera_from_map, to_observations(view_, matches), options);
      if (!next) return std::nullopt;
      pose = std::move(*next);
    }
    return pose;
  }

 private:
  void project(const SE3& camera_from_map) {
    seen_.points.clear();
    for (ProjectedPoint point : sample_) {
      const Eigen::Vector3d in_camera = camera_from_map * point.position;
      const auto pixel = camera_.project(in_camera);
      if (!pixel || !camera_.in_image(*pixel)) continue;
      point.pixel = *pixel;
      point.depth = in_camera.z();
      seen_.points.push_back(point);
    }
  }

  const PlaceView& view_;
  const CornerGrid& grid_;
  const Camera& camera_;
  const SettleOptions& options_;
  const MatchOptions& matching_;
  std::vector<ProjectedPoint> sample_;
  ProjectedPoints seen_;  ///< of the sample, by the pose that is looked from
};

/// Poses found from aside which explain nearly as much of the sample as the pose does, the best first.
std::vector<PoseEstimate> find_others(Sample sample, const SE3& camera_from_map, double depth,
                                      const SettleOptions& options) {
  const auto own = sample.look_from(camera_from_map);
  if (!own) return {};
  std::vector<PoseEstimate> found;
  for (const SE3& aside : poses_aside(camera_from_map, depth, options.aside)) {
    auto other = sample.look_from(aside);
    if (other && support_of(*other) >= options.nearly_as_good * support_of(*own))
      found.push_back(std::move(*other));
  }
  std::ranges::stable_sort(found, std::greater(), support_of);
  std::vector<PoseEstimate> distinct;
  for (PoseEstimate& pose : found) {
    const auto is_same = [&](const SE3& other) {
      return separation(pose.camera_from_map, other, depth) < options.same;
    };
    if (is_same(own->camera_from_map) ||
        std::ranges::any_of(distinct, is_same, &PoseEstimate::camera_from_map))
      continue;
    distinct.push_back(std::move(pose));
  }
  return distinct;
}

}  // namespace

double position_sigma(const PlaceView& view, const Camera& camera, const Refined& refined) {
  const std::vector<PlaceMatch>& matches = refined.guided.matches;
  const std::vector<double>& weights = refined.pose.weights;
  PerCell<double> in_cell{};
  for (size_t i = 0; i < matches.size(); ++i)
    in_cell[image_cell_of(view.corners[matches[i].corner].pixel, camera)] += weights[i];
  Matrix6d information = Matrix6d::Zero();
  for (size_t i = 0; i < matches.size(); ++i) {
    const PlaceCorner& corner = view.corners[matches[i].corner];
    const auto d_pixel = pixel_by_pose(camera, refined.pose.camera_from_map * matches[i].position);
    if (!(weights[i] > 0) || !d_pixel) continue;
    const double sigma = 1 << corner.level;
    const double share = weights[i] / in_cell[image_cell_of(corner.pixel, camera)];
    information += share / (sigma * sigma) * d_pixel->transpose() * *d_pixel;
  }
  const Eigen::LDLT<Matrix6d> factor(information);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > 0))
    return std::numeric_limits<double>::infinity();
  // A step of the pose, translation first, moves the camera's centre by as much.
  const Matrix6d covariance = factor.solve(Matrix6d::Identity());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> position(covariance.topLeftCorner<3, 3>());
  return std::max(1.0, refined.pose.rms) * std::sqrt(position.eigenvalues().maxCoeff());
}

Refined settle(const PlaceView& view, const CornerGrid& grid, const Camera& camera, const IndexedMap& map,
               size_t keyframe, Refined refined, double depth, const SettleOptions& options,
               const RefineOptions& refining, const MatchOptions& matching) {
  for (int move = 0; move < options.most_moves; ++move) {
    std::optional<Refined> better;
    double most = support_of(refined.pose);
    const auto found = find_others(Sample(view, grid, camera, refined.points, options, matching),
                                   refined.pose.camera_from_map, depth, options);
    for (size_t i = 0; i < std::min<size_t>(options.most_refined, found.size()); ++i) {
      auto other =
          refine(view, grid, camera, map, keyframe, as_certain(found[i].camera_from_map), refining, matching);
      if (!other || support_of(other->pose) <= most) continue;
      most = support_of(other->pose);
      better = std::move(*other);
    }
    if (!better) break;
    refined = std::move(*better);
  }
  return refined;
}

PoseEstimate as_certain(const SE3& camera_from_map) {
  PoseEstimate pose;
  pose.camera_from_map = camera_from_map;
  pose.covariance.setZero();
  return pose;
}

}  // namespace cairn
