// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bundle_file.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iomanip>
#include <limits>
#include <sstream>

namespace cairn {
namespace {

constexpr const char* kMagic = "cairn-bundle";
constexpr size_t kMaxCount = 100'000'000;

tl::unexpected<Error> damaged(const std::string& path, const char* what) {
  return fail(ErrorCode::kDamaged, path + ": " + what);
}

bool indices_hold(const BundleProblem& problem) {
  return std::all_of(problem.observations.begin(), problem.observations.end(), [&](const auto& o) {
    return o.pose >= 0 && o.pose < static_cast<int>(problem.poses.size()) && o.point >= 0 &&
           o.point < static_cast<int>(problem.points.size());
  });
}

std::vector<CameraPtr> distinct_cameras(const BundleProblem& problem) {
  std::vector<CameraPtr> cameras;
  for (const BundlePose& p : problem.poses) {
    if (std::find(cameras.begin(), cameras.end(), p.camera) == cameras.end()) cameras.push_back(p.camera);
  }
  return cameras;
}

Result<std::vector<CameraPtr>> read_cameras(std::istream& in, size_t count, const std::string& path) {
  std::vector<CameraPtr> cameras;
  for (size_t i = 0; i < count; ++i) {
    CameraParameters parameters;
    int model = 0;
    size_t values = 0;
    in >> model >> parameters.width >> parameters.height >> values;
    if (!in || values > 64 || !is_camera_model(model)) return damaged(path, "a camera is cut short");
    parameters.model = static_cast<CameraModel>(model);
    parameters.values.resize(values);
    for (double& v : parameters.values) in >> v;
    auto camera = make_camera(parameters);
    if (!camera) return tl::unexpected(camera.error());
    cameras.push_back(*camera);
  }
  return cameras;
}

Result<BundleProblem> read_own(std::istream& in, const std::string& path) {
  size_t cameras = 0, poses = 0, points = 0, observations = 0;
  in >> cameras >> poses >> points >> observations;
  if (!in || std::max({cameras, poses, points, observations}) > kMaxCount)
    return damaged(path, "counts are missing");
  const auto known = read_cameras(in, cameras, path);
  if (!known) return tl::unexpected(known.error());
  BundleProblem problem;
  problem.poses.resize(poses);
  for (BundlePose& p : problem.poses) {
    size_t camera = 0;
    Eigen::Vector3d t;
    Eigen::Quaterniond q;
    in >> camera >> p.fixed >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w();
    if (!in || camera >= known->size()) return damaged(path, "a pose is damaged");
    p.camera = (*known)[camera];
    p.camera_from_map = SE3(q, t);
  }
  problem.points.resize(points);
  for (Eigen::Vector3d& p : problem.points) in >> p.x() >> p.y() >> p.z();
  problem.observations.resize(observations);
  for (BundleObservation& o : problem.observations)
    in >> o.pose >> o.point >> o.pixel.x() >> o.pixel.y() >> o.inverse_sigma;
  if (!in || !indices_hold(problem)) return damaged(path, "points or observations are damaged");
  return problem;
}

Result<BundlePose> bal_camera(std::istream& in, const std::string& path) {
  Eigen::Vector3d angle_axis, t;
  double f = 0, k1 = 0, k2 = 0;
  for (double& v : angle_axis) in >> v;
  for (double& v : t) in >> v;
  in >> f >> k1 >> k2;
  if (!in) return damaged(path, "a camera is cut short");
  CameraParameters parameters;
  parameters.width = parameters.height = 1;  // unknown, and projection does not ask
  parameters.values = {f, f, 0, 0, k1, k2};
  auto camera = make_camera(parameters);
  if (!camera) return tl::unexpected(camera.error());
  const SE3 half_turn(Eigen::Quaterniond(0, 1, 0, 0), Eigen::Vector3d::Zero());
  return BundlePose{half_turn * SE3(so3_exp(angle_axis), t), *camera, false};
}

Result<BundleProblem> read_bal(std::istream& in, const std::string& path) {
  size_t cameras = 0, points = 0, observations = 0;
  in >> cameras >> points >> observations;
  if (!in || std::max({cameras, points, observations}) > kMaxCount)
    return damaged(path, "neither a dump of ours nor BAL");
  BundleProblem problem;
  problem.observations.resize(observations);
  for (BundleObservation& o : problem.observations) {
    in >> o.pose >> o.point >> o.pixel.x() >> o.pixel.y();
    o.pixel.y() = -o.pixel.y();
  }
  for (size_t i = 0; i < cameras; ++i) {
    auto pose = bal_camera(in, path);
    if (!pose) return tl::unexpected(pose.error());
    problem.poses.push_back(*pose);
  }
  if (!problem.poses.empty()) problem.poses.front().fixed = true;
  problem.points.resize(points);
  for (Eigen::Vector3d& p : problem.points) in >> p.x() >> p.y() >> p.z();
  if (!in || !indices_hold(problem)) return damaged(path, "points or observations are damaged");
  return problem;
}

}  // namespace

Status write_bundle(const std::string& path, const BundleProblem& problem) {
  std::ofstream out(path);
  out << std::setprecision(std::numeric_limits<double>::max_digits10);
  const std::vector<CameraPtr> cameras = distinct_cameras(problem);
  out << kMagic << ' ' << cameras.size() << ' ' << problem.poses.size() << ' ' << problem.points.size() << ' '
      << problem.observations.size() << '\n';
  for (const CameraPtr& camera : cameras) {
    const CameraParameters& p = camera->parameters();
    out << static_cast<int>(p.model) << ' ' << p.width << ' ' << p.height << ' ' << p.values.size();
    for (const double v : p.values) out << ' ' << v;
    out << '\n';
  }
  for (const BundlePose& p : problem.poses) {
    const auto camera = std::find(cameras.begin(), cameras.end(), p.camera) - cameras.begin();
    const auto& q = p.camera_from_map.rotation();
    out << camera << ' ' << p.fixed << ' ' << p.camera_from_map.translation().transpose() << ' ' << q.x()
        << ' ' << q.y() << ' ' << q.z() << ' ' << q.w() << '\n';
  }
  for (const Eigen::Vector3d& p : problem.points) out << p.transpose() << '\n';
  for (const BundleObservation& o : problem.observations)
    out << o.pose << ' ' << o.point << ' ' << o.pixel.transpose() << ' ' << o.inverse_sigma << '\n';
  out.close();
  if (!out) return fail(ErrorCode::kIo, path + ": cannot be written");
  return {};
}

Result<BundleProblem> read_bundle(const std::string& path) {
  std::ifstream in(path);
  if (!in) return fail(ErrorCode::kIo, path + ": cannot be read");
  std::string first;
  in >> first;
  if (first == kMagic) return read_own(in, path);
  in.seekg(0);
  return read_bal(in, path);
}

}  // namespace cairn
