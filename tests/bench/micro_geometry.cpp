// SPDX-License-Identifier: Apache-2.0
//
// cairn-micro: poses and motions of a camera from matches, beside OpenCV's.
#include <benchmark/benchmark.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>
#include <vector>

#include "common/geometry/multi_view.h"
#include "common/geometry/pose.h"
#include "common/geometry/two_view.h"

namespace cairn {
namespace {

constexpr double kFocalLength = 525;  // [px]
constexpr double kNoise = 0.7;        // [px]
constexpr int kWrongOnes = 10;        // one match in so many

CameraPtr camera_without_distortion() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {kFocalLength, kFocalLength, 319.5, 239.5}});
}

cv::Mat opencv_matrix() {
  return (cv::Mat_<double>(3, 3) << kFocalLength, 0, 319.5, 0, kFocalLength, 239.5, 0, 0, 1);
}

/// Points at many depths, seen by a camera that moves sideways: exactly in the first view, with noise in four
/// further ones, one in ten wrongly in the last.
struct SideStep {
  explicit SideStep(size_t count) : camera(camera_without_distortion()) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(0, 1);
    std::normal_distribution<double> noise(0, kNoise);
    for (const double fraction : {0.25, 0.5, 0.75, 1.0}) views.further.push_back({fraction, {}});
    while (matches.size() < count) {
      const Eigen::Vector2d a{20 + 600 * uniform(random), 20 + 440 * uniform(random)};
      const Eigen::Vector3d point = camera->unproject(a) * (1 + uniform(random));
      std::vector<Eigen::Vector2d> seen;
      for (const FurtherView& view : views.further) {
        const SE3 pose(so3_exp(view.baseline_fraction * Eigen::Vector3d(0.02, -0.03, 0.01)),
                       view.baseline_fraction * Eigen::Vector3d(0.08, 0.01, 0.02 * view.baseline_fraction));
        const auto pixel = camera->project(pose * point);
        if (pixel && camera->in_image(*pixel))
          seen.push_back(*pixel + Eigen::Vector2d{noise(random), noise(random)});
      }
      if (seen.size() < views.further.size()) continue;
      if (matches.size() % kWrongOnes == 0) seen.back() = {640 * uniform(random), 480 * uniform(random)};
      matches.push_back({a, seen.back()});
      views.first.push_back(a);
      for (size_t i = 0; i < seen.size(); ++i) views.further[i].pixels.push_back(seen[i]);
    }
    options.sigma = kNoise;
  }

  CameraPtr camera;
  std::vector<PixelMatch> matches;
  MultiView views;
  TwoViewOptions options;
};

void BM_FindMotions(benchmark::State& state) {
  const SideStep step(static_cast<size_t>(state.range(0)));
  for (auto _ : state) {
    const auto motions = find_motions(*step.camera, *step.camera, step.matches, step.options);
    if (!motions) state.SkipWithError(motions.error().message.c_str());
    benchmark::DoNotOptimize(motions);
  }
}
BENCHMARK(BM_FindMotions)->Arg(200)->Arg(1000)->Unit(benchmark::kMillisecond);

/// One model only, not refined; find_motions tries two, compares and refines them.
void BM_EssentialMatrixOfOpenCv(benchmark::State& state) {
  cv::setNumThreads(1);
  const SideStep step(static_cast<size_t>(state.range(0)));
  std::vector<cv::Point2d> a;
  std::vector<cv::Point2d> b;
  for (const PixelMatch& match : step.matches) {
    a.emplace_back(match.a.x(), match.a.y());
    b.emplace_back(match.b.x(), match.b.y());
  }
  const cv::Mat matrix = opencv_matrix();
  for (auto _ : state)
    benchmark::DoNotOptimize(cv::findEssentialMat(a, b, matrix, cv::RANSAC, 0.999, 2 * kNoise));
}
BENCHMARK(BM_EssentialMatrixOfOpenCv)->Arg(200)->Arg(1000)->Unit(benchmark::kMillisecond);

/// One motion of the pair with four views.
void BM_AdjustMotions(benchmark::State& state) {
  const SideStep step(static_cast<size_t>(state.range(0)));
  const auto motions = find_motions(*step.camera, *step.camera, step.matches, step.options);
  if (!motions) return state.SkipWithError(motions.error().message.c_str());
  const std::span<const SE3> first(motions->b_from_a.data(), 1);
  for (auto _ : state) benchmark::DoNotOptimize(adjust_motions(*step.camera, step.views, first));
}
BENCHMARK(BM_AdjustMotions)->Arg(200)->Arg(1000)->Unit(benchmark::kMillisecond);

std::vector<PointObservation> observe(const Camera& camera, int count) {
  std::vector<PointObservation> observations;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d pixel((i * 97) % camera.width(), (i * 61) % camera.height());
    const double depth = 1.0 + 0.1 * (i % 7);
    const Eigen::Vector2d noise(0.3 * ((i % 5) - 2), 0.3 * ((i % 3) - 1));
    observations.push_back({camera.unproject(pixel) * depth, pixel + noise, 1.0});
  }
  return observations;
}

const SE3 kPoseStart(so3_exp({0.01, -0.01, 0.005}), {0.01, 0.02, -0.01});

void BM_PoseOfPoints(benchmark::State& state) {
  const CameraPtr camera = camera_without_distortion();
  const auto observations = observe(*camera, static_cast<int>(state.range(0)));
  PoseWorkspace workspace;
  PoseEstimate estimate;
  for (auto _ : state) {
    benchmark::DoNotOptimize(optimize_pose(*camera, kPoseStart, observations, {}, &workspace, &estimate));
  }
}
BENCHMARK(BM_PoseOfPoints)->Arg(100)->Arg(500)->Arg(1000);

/// Least squares by Levenberg-Marquardt from the same start, not robust.
void BM_PoseOfOpenCv(benchmark::State& state) {
  cv::setNumThreads(1);
  const CameraPtr camera = camera_without_distortion();
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (const PointObservation& o : observe(*camera, static_cast<int>(state.range(0)))) {
    points.emplace_back(o.point_in_map.x(), o.point_in_map.y(), o.point_in_map.z());
    pixels.emplace_back(o.pixel.x(), o.pixel.y());
  }
  const cv::Mat matrix = opencv_matrix();
  const Eigen::Vector3d rotation = so3_log(kPoseStart.rotation());
  const Eigen::Vector3d& translation = kPoseStart.translation();
  for (auto _ : state) {
    cv::Mat r = (cv::Mat_<double>(3, 1) << rotation.x(), rotation.y(), rotation.z());
    cv::Mat t = (cv::Mat_<double>(3, 1) << translation.x(), translation.y(), translation.z());
    cv::solvePnP(points, pixels, matrix, cv::noArray(), r, t, true, cv::SOLVEPNP_ITERATIVE);
    benchmark::DoNotOptimize(t);
  }
}
BENCHMARK(BM_PoseOfOpenCv)->Arg(100)->Arg(500)->Arg(1000);

}  // namespace
}  // namespace cairn
