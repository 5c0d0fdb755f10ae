// SPDX-License-Identifier: Apache-2.0
//
// Hot functions one by one, on a frame of the simulated desk, with yardsticks in the same run: a copy of the
// frame, OpenCV's FAST and pyramid. README.md has the figures.
#include <benchmark/benchmark.h>

#include <cstring>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "client/tracking/frame_images.h"
#include "client/tracking/motion.h"
#include "common/geometry/pose.h"
#include "common/geometry/two_view.h"
#include "common/image/patch.h"
#include "tests/world/simulator.h"

namespace cairn {
namespace {

constexpr int kFrame = 40;  // of the simulated desk

Simulator desk() {
  return std::move(Simulator::make("desk", {}).value());
}

const GrayImage& frame() {
  static const GrayImage image = desk().frame(kFrame).image;
  return image;
}

FrameImages prepare() {
  FrameImages images;
  images.build_pyramid(frame().view());
  images.find_corners();
  images.build_tiny();
  return images;
}

const FrameImages& prepared() {
  static const FrameImages images(prepare());
  return images;
}

void BM_CopyOfTheFrame(benchmark::State& state) {
  const GrayImage& image = frame();
  GrayImage copy(image.width(), image.height());
  for (auto _ : state) {
    copy.assign(image);
    benchmark::DoNotOptimize(copy);
  }
}
BENCHMARK(BM_CopyOfTheFrame);

void BM_Pyramid(benchmark::State& state) {
  Pyramid pyramid;
  for (auto _ : state) pyramid.build(frame().view());
}
BENCHMARK(BM_Pyramid);

cv::Mat as_mat(const GrayView& image) {
  cv::Mat mat(image.height, image.width, CV_8UC1);
  for (int y = 0; y < image.height; ++y)
    std::memcpy(mat.ptr(y), image.row(y), static_cast<size_t>(image.width));
  return mat;
}

void BM_PyramidOfOpenCv(benchmark::State& state) {
  cv::setNumThreads(1);
  const cv::Mat level0 = as_mat(frame().view());
  std::array<cv::Mat, kPyramidLevels> levels;
  levels[0] = level0;
  for (auto _ : state) {
    for (size_t l = 1; l < levels.size(); ++l)
      cv::resize(levels[l - 1], levels[l], {}, 0.5, 0.5, cv::INTER_AREA);
  }
}
BENCHMARK(BM_PyramidOfOpenCv);

void BM_Fast10OnFourLevels(benchmark::State& state) {
  FrameImages images = prepare();
  for (auto _ : state) images.find_corners();
}
BENCHMARK(BM_Fast10OnFourLevels);

void BM_FastOfOpenCvOnFourLevels(benchmark::State& state) {
  cv::setNumThreads(1);
  std::array<cv::Mat, kPyramidLevels> levels;
  for (int l = 0; l < kPyramidLevels; ++l)
    levels[static_cast<size_t>(l)] = as_mat(prepared().pyramid.level(l).view());
  std::vector<cv::KeyPoint> corners;
  for (auto _ : state) {
    for (size_t l = 0; l < levels.size(); ++l)
      cv::FAST(levels[l], corners, FrameImages::kFastThresholds[l], false,
               cv::FastFeatureDetector::TYPE_9_16);
  }
}
BENCHMARK(BM_FastOfOpenCvOnFourLevels);

/// A patch around a candidate of level 0, as the tracker has it.
struct PatchAtCorner {
  PatchAtCorner() {
    const GrayView image = prepared().pyramid.level(0).view();
    const auto candidates = find_candidates(image, prepared().corners[0]);
    corner = candidates[candidates.size() / 2].corner;
    cut = cut_source_patch(image, corner, &source) && make_template(source, Warp::Identity(), 0, &patch);
  }
  Corner corner;
  SourcePatch source{};
  PatchTemplate patch;
  bool cut = false;
};

void BM_MakeTemplate(benchmark::State& state) {
  const PatchAtCorner at;
  Warp warp;
  warp << 0.96F, -0.21F, 0.24F, 0.93F;
  PatchTemplate patch;
  for (auto _ : state) benchmark::DoNotOptimize(make_template(at.source, warp, 0, &patch));
}
BENCHMARK(BM_MakeTemplate);

void BM_FindPatch(benchmark::State& state) {
  const PatchAtCorner at;
  const Eigen::Vector2f center(static_cast<float>(at.corner.x) + 2, static_cast<float>(at.corner.y) - 2);
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        find_patch(at.patch, prepared().pyramid.level(0).view(), prepared().corners[0], center, 10));
  }
}
BENCHMARK(BM_FindPatch);

void BM_RefinePatch(benchmark::State& state) {
  const PatchAtCorner at;
  const Eigen::Vector2f start(static_cast<float>(at.corner.x) + 0.6F, static_cast<float>(at.corner.y) - 0.4F);
  for (auto _ : state)
    benchmark::DoNotOptimize(refine_patch(at.patch, prepared().pyramid.level(0).view(), start));
}
BENCHMARK(BM_RefinePatch);

void BM_TinyImage(benchmark::State& state) {
  FrameImages images = prepare();
  for (auto _ : state) images.build_tiny();
}
BENCHMARK(BM_TinyImage);

void BM_PoseOfPoints(benchmark::State& state) {
  Simulator simulator = desk();
  const Camera& camera = simulator.camera();
  std::vector<PointObservation> observations;
  for (int i = 0; i < static_cast<int>(state.range(0)); ++i) {
    const Eigen::Vector2d pixel((i * 97) % camera.width(), (i * 61) % camera.height());
    const double depth = 1.0 + 0.1 * (i % 7);
    const Eigen::Vector2d noise(0.3 * ((i % 5) - 2), 0.3 * ((i % 3) - 1));
    observations.push_back({camera.unproject(pixel) * depth, pixel + noise, 1.0});
  }
  const SE3 start(so3_exp({0.01, -0.01, 0.005}), {0.01, 0.02, -0.01});
  for (auto _ : state) benchmark::DoNotOptimize(optimize_pose(camera, start, observations));
}
BENCHMARK(BM_PoseOfPoints)->Arg(100)->Arg(500)->Arg(1000);

void BM_SimulatedFrame(benchmark::State& state) {
  Simulator simulator = desk();
  int index = 0;
  for (auto _ : state) benchmark::DoNotOptimize(simulator.frame(index++ % simulator.frame_count()));
}
BENCHMARK(BM_SimulatedFrame)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn

BENCHMARK_MAIN();
