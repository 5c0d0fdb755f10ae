// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/cube/adjust.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <memory>
#include <numeric>

#include "common/geometry/triangulation.h"

namespace cairn::cube {
namespace {

constexpr int kCameraParameters = 5;  ///< focal, aspect, cx, cy, k1
constexpr int kPoseParameters = 6;    ///< rotation vector, translation
constexpr int kBoxParameters = 10;
using PoseBlock = std::array<double, kPoseParameters>;
using CameraBlock = std::array<double, kCameraParameters>;

template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

template <typename T>
void to_pixel(const T* camera, const Eigen::Matrix<T, 2, 1>& m, T* pixel) {
  const T radial = T(1) + camera[4] * m.squaredNorm();
  pixel[0] = camera[0] * radial * m.x() + camera[2];
  pixel[1] = camera[0] * camera[1] * radial * m.y() + camera[3];
}

template <typename T>
Vector3<T> rotated(const T* pose, const Vector3<T>& v) {
  Vector3<T> out;
  ceres::AngleAxisRotatePoint(pose, v.data(), out.data());
  return out;
}

/// Centre of a dot and the axes of its face, in the object frame.
template <typename T>
struct DotGeometry {
  Vector3<T> centre, along, down;
};

template <typename T>
DotGeometry<T> geometry(const Dot& dot, const T* box) {
  const T u = T(dot.column - 1.5);
  if (dot.face == Face::kTop) {
    return {{u, T(dot.row - 1.5), T(0)}, {T(1), T(0), T(0)}, {T(0), T(1), T(0)}};
  }
  const bool front = dot.face == Face::kFront;
  const T lean = front ? box[kFrontLean] : box[kLeftLean];
  const T depth = box[front ? kFrontDepth : kLeftDepth] + T(dot.row) * box[kSideSpacing];
  const T out = (front ? box[kFrontDistance] : box[kLeftDistance]) + depth * sin(lean);
  const T in = depth * cos(lean);
  const T shift = u * box[kSideSpacing] + box[front ? kFrontShift : kLeftShift];
  if (front) return {{shift, out, in}, {T(1), T(0), T(0)}, {T(0), sin(lean), cos(lean)}};
  return {{-out, shift, in}, {T(0), T(1), T(0)}, {-sin(lean), T(0), cos(lean)}};
}

struct DotResidual {
  Dot dot;
  Eigen::Vector2d pixel;

  template <typename T>
  bool operator()(const T* camera, const T* pose, const T* box, T* residual) const {
    const DotGeometry<T> g = geometry(dot, box);
    const Vector3<T> centre = rotated(pose, g.centre) + Eigen::Map<const Vector3<T>>(pose + 3);
    if (!(centre.z() > T(0.1))) return false;
    const Vector3<T> a = rotated(pose, g.along) * box[kRadius];
    const Vector3<T> b = rotated(pose, g.down) * box[kRadius];
    to_pixel(camera, ellipse_centre<T>(centre, a, b), residual);
    residual[0] -= pixel.x();
    residual[1] -= pixel.y();
    return true;
  }
};

struct PointResidual {
  Eigen::Vector2d pixel;

  template <typename T>
  bool operator()(const T* camera, const T* pose, const T* point, T* residual) const {
    const Vector3<T> p =
        rotated<T>(pose, Eigen::Map<const Vector3<T>>(point)) + Eigen::Map<const Vector3<T>>(pose + 3);
    if (!(p.z() > T(1e-3))) return false;
    to_pixel<T>(camera, p.hnormalized(), residual);
    residual[0] -= pixel.x();
    residual[1] -= pixel.y();
    return true;
  }
};

CameraBlock to_block(const CubeCamera& c) {
  return {c.focal, c.aspect, c.cx, c.cy, c.k1};
}
CubeCamera to_camera(const CameraBlock& b) {
  return {b[0], b[1], b[2], b[3], b[4]};
}

PoseBlock to_block(const SE3& pose) {
  const Eigen::Vector3d w = so3_log(pose.rotation());
  const Eigen::Vector3d& t = pose.translation();
  return {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()};
}

SE3 to_se3(const PoseBlock& b) {
  return {so3_exp({b[0], b[1], b[2]}), Eigen::Vector3d(b[3], b[4], b[5])};
}

/// Holds all entries of a block but those told free.
void hold_all_but(ceres::Problem* problem, double* block, int size, const std::vector<int>& free) {
  std::vector<int> held;
  for (int i = 0; i < size; ++i) {
    if (std::find(free.begin(), free.end(), i) == free.end()) held.push_back(i);
  }
  if (!held.empty()) problem->SetManifold(block, new ceres::SubsetManifold(size, held));
}

std::vector<int> free_camera(const Freedom& freedom) {
  std::vector<int> free{0};
  if (freedom.aspect) free.push_back(1);
  if (freedom.centre) free.insert(free.end(), {2, 3});
  if (freedom.k1) free.push_back(4);
  return free;
}

/// Sigma of the coordinates of residuals from the median of their lengths, which is sigma sqrt(2 ln 2).
double robust_scale(std::vector<double> lengths) {
  const auto middle = lengths.begin() + static_cast<ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  return std::max(1e-6, *middle / std::sqrt(2 * std::log(2.0)));
}

/// A problem with its blocks, solved in two passes.
struct Adjustment {
  /// Loss of all residual blocks; it is exchanged between the passes, and outlives the problem.
  ceres::LossFunctionWrapper loss{new ceres::CauchyLoss(0.2), ceres::TAKE_OWNERSHIP};
  ceres::Problem problem{keep_loss()};
  CameraBlock camera{};
  std::vector<PoseBlock> poses;
  std::vector<ceres::ResidualBlockId> blocks;
  double robust_sigma = 0;

  explicit Adjustment(const CubeCamera& start) : camera(to_block(start)) {}

  static ceres::Problem::Options keep_loss() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  [[nodiscard]] bool solve(ceres::LinearSolverType solver) {
    ceres::Solver::Options options;
    options.linear_solver_type = solver;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-7;
    options.num_threads = 2;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return summary.IsSolutionUsable();
  }

  /// Lengths of the residuals [px].
  [[nodiscard]] std::vector<double> lengths() {
    ceres::Problem::EvaluateOptions options;
    options.residual_blocks = blocks;
    options.apply_loss_function = false;
    std::vector<double> residuals;
    problem.Evaluate(options, nullptr, &residuals, nullptr, nullptr);
    std::vector<double> lengths(blocks.size());
    for (size_t i = 0; i < blocks.size(); ++i)
      lengths[i] = std::hypot(residuals[2 * i], residuals[2 * i + 1]);
    return lengths;
  }

  /// `scale`: of the residuals [px]; 0 to find it first. 2.385 sigma keeps 95 % of least squares' efficiency
  /// if errors are normal; Cauchy's weights never vanish, so no point is left without a measurement.
  [[nodiscard]] bool solve_robustly(ceres::LinearSolverType solver, double scale) {
    if (scale <= 0) {
      if (!solve(solver)) return false;
      scale = robust_scale(lengths());
    }
    robust_sigma = scale;
    loss.Reset(new ceres::CauchyLoss(2.385 * scale), ceres::TAKE_OWNERSHIP);
    return solve(solver);
  }

  /// Unknowns that are free.
  [[nodiscard]] int freedoms() const {
    std::vector<double*> all;
    problem.GetParameterBlocks(&all);
    int sum = 0;
    for (const double* block : all) {
      if (!problem.IsParameterBlockConstant(block)) sum += problem.ParameterBlockTangentSize(block);
    }
    return sum;
  }

  /// Everything of a fit but the box.
  [[nodiscard]] Result<CameraFit> fit() {
    CameraFit fit;
    fit.camera = to_camera(camera);
    fit.residuals = lengths();
    fit.scale = robust_sigma;
    for (const PoseBlock& pose : poses) fit.camera_from_object.push_back(to_se3(pose));
    const double surplus = 2.0 * static_cast<double>(blocks.size()) - freedoms();
    if (!(surplus > 0)) return fail(ErrorCode::kDegenerate, "more unknowns than measurements");
    double cost = 0;
    problem.Evaluate({}, &cost, nullptr, nullptr, nullptr);
    const double variance = 2 * cost / surplus;
    fit.rms = std::sqrt(variance);

    ceres::Covariance covariance({});
    const std::vector<const double*> wanted{camera.data()};
    if (!covariance.Compute(wanted, &problem)) {
      return fail(ErrorCode::kDegenerate, "the measurements do not determine the camera");
    }
    std::array<double, kCameraParameters * kCameraParameters> c{};
    covariance.GetCovarianceBlock(camera.data(), camera.data(), c.data());
    CameraBlock sigma{};
    for (size_t i = 0; i < sigma.size(); ++i) sigma[i] = std::sqrt(variance * c[i * (sigma.size() + 1)]);
    fit.sigma = to_camera(sigma);
    return fit;
  }
};

/// Pose of the top face from its homography and the camera (without distortion): H ~ K [r1 r2 t].
SE3 pose_from_dots(const std::vector<DotSighting>& top, const CubeCamera& camera) {
  std::vector<Eigen::Vector2d> grid, pixels;
  for (const DotSighting& s : top) {
    grid.emplace_back(s.dot.column - 1.5, s.dot.row - 1.5);
    pixels.push_back(s.pixel);
  }
  Eigen::Matrix3d k;
  k << camera.focal, 0, camera.cx, 0, camera.focal * camera.aspect, camera.cy, 0, 0, 1;
  Eigen::Matrix3d h = k.inverse() * fit_homography(grid, pixels);
  h /= std::sqrt(h.col(0).norm() * h.col(1).norm());
  if (h(2, 2) < 0) h = -h;
  Eigen::Matrix3d r;
  r.col(0) = h.col(0).normalized();
  r.col(2) = h.col(0).cross(h.col(1)).normalized();
  r.col(1) = r.col(2).cross(r.col(0));
  return {r, h.col(2)};
}

}  // namespace

Result<CameraFit> fit_to_dots(const std::vector<DotSighting>& sightings, const CubeCamera& start,
                              const Freedom& freedom, double scale) {
  int frames = 0;
  for (const DotSighting& s : sightings) frames = std::max(frames, s.frame + 1);
  std::vector<std::vector<DotSighting>> top(static_cast<size_t>(frames));
  for (const DotSighting& s : sightings) {
    if (s.dot.face == Face::kTop) top[static_cast<size_t>(s.frame)].push_back(s);
  }

  Adjustment adjustment(start);
  adjustment.poses.resize(top.size());
  for (size_t i = 0; i < top.size(); ++i) {
    if (top[i].size() >= 4) adjustment.poses[i] = to_block(pose_from_dots(top[i], start));
  }
  std::array<double, kBoxParameters> box{0.2, 2.2, 0, 0.8, 2.2, 0, 0.8, 1, 0, 0};
  bool sides = false;
  std::vector<size_t> used;
  for (size_t i = 0; i < sightings.size(); ++i) {
    const DotSighting& s = sightings[i];
    const auto frame = static_cast<size_t>(s.frame);
    const bool side = s.dot.face != Face::kTop;
    if (top[frame].size() < 4 || (side && !freedom.side_faces)) continue;
    sides |= side;
    used.push_back(i);
    adjustment.blocks.push_back(adjustment.problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<DotResidual, 2, kCameraParameters, kPoseParameters, kBoxParameters>(
            new DotResidual{s.dot, s.pixel}),
        &adjustment.loss, adjustment.camera.data(), adjustment.poses[frame].data(), box.data()));
  }
  if (used.size() < 20) return fail(ErrorCode::kDegenerate, "too few dots");
  hold_all_but(&adjustment.problem, adjustment.camera.data(), kCameraParameters, free_camera(freedom));
  // The radius is told by the image (its blobs) to a tenth; its effect is a hundredth of a pixel.
  std::vector<int> free_box;
  if (sides) {
    free_box = {kFrontDistance, kFrontShift, kFrontDepth, kLeftDistance,
                kLeftShift,     kLeftDepth,  kSideSpacing};
  }
  if (sides && !freedom.right_angles) free_box.insert(free_box.end(), {kFrontLean, kLeftLean});
  if (free_box.empty()) {
    adjustment.problem.SetParameterBlockConstant(box.data());
  } else {
    hold_all_but(&adjustment.problem, box.data(), kBoxParameters, free_box);
  }
  if (!adjustment.solve_robustly(ceres::SPARSE_NORMAL_CHOLESKY, scale)) {
    return fail(ErrorCode::kDegenerate, "the adjustment of the dots does not converge");
  }
  Result<CameraFit> fit = adjustment.fit();
  if (fit) std::copy(box.begin(), box.end(), fit->box.data());
  return fit;
}

namespace {

/// Start of a track's point: from its two most distant views, in the object frame.
Result<Eigen::Vector3d> start_point(const Track& track, const std::vector<SE3>& poses,
                                    const CubeCamera& camera) {
  const Track::Sighting* a = &track.sightings.front();
  const Track::Sighting* b = a;
  const auto pose = [&](const Track::Sighting* s) -> const SE3& {
    return poses[static_cast<size_t>(s->frame)];
  };
  for (const Track::Sighting& s : track.sightings) {
    if ((pose(&s).center() - pose(a).center()).norm() > (pose(b).center() - pose(a).center()).norm()) b = &s;
  }
  const auto ray = [&](const Track::Sighting* s) {
    const Eigen::Vector2d m((s->pixel.x() - camera.cx) / camera.focal,
                            (s->pixel.y() - camera.cy) / (camera.focal * camera.aspect));
    return Eigen::Vector3d(m.homogeneous().normalized());
  };
  const auto in_a = triangulate(pose(b) * pose(a).inverse(), ray(a), ray(b));
  if (!in_a) return in_a;
  return pose(a).inverse() * *in_a;
}

}  // namespace

Result<CameraFit> fit_to_tracks(const std::vector<Track>& tracks, const SceneStart& start,
                                const Freedom& freedom) {
  const std::vector<SE3>& start_poses = start.camera_from_object;
  Adjustment adjustment(start.camera);
  for (const SE3& pose : start_poses) adjustment.poses.push_back(to_block(pose));
  std::vector<Eigen::Vector3d> points = start.points;
  points.resize(tracks.size(), Eigen::Vector3d::Zero());
  int first = INT_MAX, last = -1;
  for (size_t i = 0; i < tracks.size(); ++i) {
    if (tracks[i].sightings.size() < 2) continue;
    if (start.points.empty()) {
      const auto point = start_point(tracks[i], start_poses, start.camera);
      if (!point) continue;
      points[i] = *point;
    }
    for (const Track::Sighting& s : tracks[i].sightings) {
      first = std::min(first, s.frame);
      last = std::max(last, s.frame);
      adjustment.blocks.push_back(adjustment.problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<PointResidual, 2, kCameraParameters, kPoseParameters, 3>(
              new PointResidual{s.pixel}),
          &adjustment.loss, adjustment.camera.data(), adjustment.poses[static_cast<size_t>(s.frame)].data(),
          points[i].data()));
    }
  }
  if (last <= first) return fail(ErrorCode::kDegenerate, "the tracks span no two frames");
  hold_all_but(&adjustment.problem, adjustment.camera.data(), kCameraParameters, free_camera(freedom));
  // The gauge: the first pose, and the longest coordinate of the way to the last one (scale).
  const Eigen::Vector3d way = start_poses[static_cast<size_t>(last)].translation() -
                              start_poses[static_cast<size_t>(first)].translation();
  Eigen::Index longest = 0;
  way.cwiseAbs().maxCoeff(&longest);
  adjustment.problem.SetParameterBlockConstant(adjustment.poses[static_cast<size_t>(first)].data());
  adjustment.problem.SetManifold(adjustment.poses[static_cast<size_t>(last)].data(),
                                 new ceres::SubsetManifold(kPoseParameters, {static_cast<int>(longest) + 3}));
  if (!adjustment.solve_robustly(ceres::DENSE_SCHUR, start.scale)) {
    return fail(ErrorCode::kDegenerate, "the adjustment of the tracks does not converge");
  }
  Result<CameraFit> fit = adjustment.fit();
  if (fit) fit->points = std::move(points);
  return fit;
}

double jackknife_sigma(const std::vector<double>& estimates) {
  const auto n = static_cast<double>(estimates.size());
  const double mean = std::accumulate(estimates.begin(), estimates.end(), 0.0) / n;
  double sum = 0;
  for (const double e : estimates) sum += (e - mean) * (e - mean);
  return std::sqrt(sum * (n - 1) / n);
}

}  // namespace cairn::cube
