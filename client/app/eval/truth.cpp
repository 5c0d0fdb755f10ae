// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/truth.h"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cstdio>
#include <numbers>
#include <span>

#include "common/base/median.h"
#include "common/io/sensor_yaml.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

/// The mount in a sensor.yaml; nothing where there is no such file, or no T_BS in it.
Result<std::optional<SensorMount>> mount_in(const fs::path& file) {
  std::error_code ignored;
  if (!fs::exists(file, ignored)) return std::nullopt;
  return read_sensor_mount(file);
}

void move_all(Trajectory* trajectory, const SE3& sensor_from_camera) {
  for (auto& segment : trajectory->segments) {
    for (auto& pose : segment.poses) pose.map_from_camera = pose.map_from_camera * sensor_from_camera;
  }
}

using Quaternions = std::vector<Eigen::Quaterniond>;

/// The rotation that a row meant if its quaternion was read as x y z w and is w x y z.
Eigen::Quaterniond with_w_first(const Eigen::Quaterniond& q) {
  return {q.x(), q.y(), q.z(), q.w()};
}

Quaternions with_w_first(Quaternions all) {
  std::transform(all.begin(), all.end(), all.begin(), [](const auto& q) { return with_w_first(q); });
  return all;
}

/// The turns between poses a quarter of the map apart, as rotation vectors in the frame of what turns.
std::vector<Eigen::Vector3d> turns_of(const Quaternions& poses) {
  const size_t apart = std::max<size_t>(1, poses.size() / 4);
  std::vector<Eigen::Vector3d> turns;
  for (size_t i = 0; i + apart < poses.size(); ++i)
    turns.push_back(so3_log(poses[i].conjugate() * poses[i + apart]));
  return turns;
}

/// Median distance of the two lists after the rotation that fits one to the other [rad].
double difference(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < a.size(); ++i) sum += b[i] * a[i].transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs(1, 1, svd.matrixU().determinant() * svd.matrixV().determinant() < 0 ? -1 : 1);
  const Eigen::Matrix3d b_from_a = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  std::vector<double> distances;
  for (size_t i = 0; i < a.size(); ++i) distances.push_back((b_from_a * a[i] - b[i]).norm());
  return reorder_to_median(std::span(distances));
}

}  // namespace

Result<ReadTrajectory> read_estimate(const fs::path& path) {
  auto trajectory = read_trajectory(path);
  if (!trajectory) return tl::unexpected(trajectory.error());
  ReadTrajectory read{std::move(*trajectory), {}};
  if (const size_t rows = read.trajectory.rows_left_out; rows > 0) {
    read.notes.push_back(path.string() + ": " + std::to_string(rows) + (rows == 1 ? " row" : " rows") +
                         " with NaN or a quaternion of zeros left out");
  }
  return read;
}

Result<ReadTrajectory> read_truth(const fs::path& path) {
  auto read = read_estimate(path);
  if (!read || !read->trajectory.is_of_body) return read;
  const auto beside = path.parent_path() / "sensor.yaml";
  const auto in_cam0 = path.parent_path() / ".." / "cam0" / "sensor.yaml";
  const auto own = mount_in(beside);
  if (!own) return tl::unexpected(own.error());
  const bool beside_is_camera = *own && (*own)->may_be("camera");
  const auto camera = beside_is_camera ? own : mount_in(in_cam0);
  if (!camera) return tl::unexpected(camera.error());
  // world_from_sensor * sensor_from_body * body_from_camera
  SE3 sensor_from_camera;
  if (*own && !beside_is_camera) sensor_from_camera = (*own)->body_from_sensor.inverse();
  if (*camera) sensor_from_camera = sensor_from_camera * (*camera)->body_from_sensor;
  move_all(&read->trajectory, sensor_from_camera);
  read->notes.push_back(
      *camera
          ? path.string() + ": poses of the body, taken to the camera by T_BS of " +
                (beside_is_camera ? beside : in_cam0.lexically_normal()).string()
          : path.string() +
                ": poses of the body, and no sensor.yaml with the camera's T_BS beside it or in ../cam0: the "
                "lever arm between them counts as error");
  return read;
}

std::optional<QuaternionDoubt> doubt_quaternions(const Comparison& comparison) {
  constexpr size_t kFewestPairs = 8;
  constexpr double kAgree = std::numbers::pi / 180;  // [rad]
  constexpr double kMuchBetter = 3;
  const auto* const map = std::max_element(
      comparison.maps.data(), comparison.maps.data() + comparison.maps.size(),
      [](const MapAlignment& a, const MapAlignment& b) { return a.pairs.size() < b.pairs.size(); });
  if (comparison.maps.empty() || map->pairs.size() < kFewestPairs) return std::nullopt;
  Quaternions truth;
  Quaternions estimate;
  for (const PosePair& pair : map->pairs) {
    truth.push_back(pair.truth_from_camera.rotation());
    estimate.push_back(pair.map_from_camera.rotation());
  }
  const double as_read = difference(turns_of(truth), turns_of(estimate));
  const double of_truth = difference(turns_of(with_w_first(truth)), turns_of(estimate));
  const double of_estimate = difference(turns_of(truth), turns_of(with_w_first(estimate)));
  const double best = std::min(of_truth, of_estimate);
  if (as_read < kAgree || as_read < kMuchBetter * best) return std::nullopt;
  return QuaternionDoubt{of_truth <= of_estimate, as_read, best};
}

std::string words_of(const QuaternionDoubt& doubt, const std::string& file) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  std::array<char, 256> figures{};
  std::snprintf(figures.data(), figures.size(),
                "its turns then differ from the other file's by %.2f degrees, read as x y z w by %.1f",
                doubt.w_first * kDegrees, doubt.as_read * kDegrees);
  return file + ": its quaternions probably have w first: " + figures.data() +
         "; put w last: awk -F'[ ,\\t]+' '/^#/ {print; next} {print $1,$2,$3,$4,$6,$7,$8,$5}' " + file +
         " > NEW";
}

}  // namespace cairn
