// SPDX-License-Identifier: Apache-2.0
//
// Hot functions one by one, on a frame of the simulated desk, with yardsticks in the same run: a copy of the
// frame, OpenCV's FAST, pyramid and ORB. FIGURES.md has the figures. Poses and motions: micro_geometry.cpp;
// the server: micro_server.cpp.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstring>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "client/tracking/motion.h"
#include "client/tracking/point_search.h"
#include "common/image/box_sums.h"
#include "common/image/frame_images.h"
#include "common/image/patch.h"
#include "common/image/place.h"
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
  (void)images.all_corners();
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
  std::array<CornerList, kPyramidLevels> corners;
  for (auto _ : state) {
    for (int level = 0; level < kPyramidLevels; ++level) {
      const auto l = static_cast<size_t>(level);
      detect_fast10(prepared().pyramid.level(level), kFastThresholds[l], &corners[l]);
    }
  }
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
      cv::FAST(levels[l], corners, kFastThresholds[l], false, cv::FastFeatureDetector::TYPE_9_16);
  }
}
BENCHMARK(BM_FastOfOpenCvOnFourLevels);

/// A patch around a candidate of level 0, as the tracker has it.
struct PatchAtCorner {
  PatchAtCorner() {
    const GrayView image = prepared().pyramid.level(0).view();
    const auto candidates = find_candidates(image, prepared().corners(0));
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
        find_patch(at.patch, prepared().pyramid.level(0).view(), prepared().corners(0), center, 10));
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

/// A strip of 24 x 5 px beside a corner, as the search along an epipolar line has them.
std::vector<PixelRun> strip_beside(Corner corner) {
  std::vector<PixelRun> runs;
  const int first = std::max<int>(corner.x - 26, kTemplateSize);
  for (int row = corner.y - 2; row <= corner.y + 2; ++row) runs.push_back({row, first, first + 23});
  return runs;
}

void BM_ZmssdSearch(benchmark::State& state) {
  const PatchAtCorner at;
  const GrayView image = prepared().pyramid.level(0).view();
  const BoxSums sums(image);
  const std::vector<PixelRun> runs = strip_beside(at.corner);
  std::vector<PatchMatch> found;
  for (auto _ : state) {
    found.clear();
    int limit = kMaxZmssd;
    search_zmssd(at.patch, image, sums, runs, 0.7F, &limit, &found);
    benchmark::DoNotOptimize(found.data());
  }
}
BENCHMARK(BM_ZmssdSearch);

void BM_ZmssdSearchOneByOne(benchmark::State& state) {
  const PatchAtCorner at;
  const GrayView image = prepared().pyramid.level(0).view();
  const std::vector<PixelRun> runs = strip_beside(at.corner);
  for (auto _ : state) {
    int best = kMaxZmssd;
    for (const PixelRun& run : runs) {
      for (int x = run.first; x <= run.last; ++x)
        best = std::min(best, zmssd_at(at.patch, image, x, run.row));
    }
    benchmark::DoNotOptimize(best);
  }
}
BENCHMARK(BM_ZmssdSearchOneByOne);

void BM_BoxSums(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(BoxSums(prepared().pyramid.level(0).view()));
}
BENCHMARK(BM_BoxSums);

/// A map of `count` points strewn over a table of 2 x 2 m, cut by one keyframe 1 m above it.
MapSnapshotPtr table_of_points(int count) {
  std::mt19937 engine(1);
  std::uniform_real_distribution<float> along(-1, 1);
  auto keyframes = std::make_shared<KeyframeBlock>();
  keyframes->live = 1;
  const KeyframeId keyframe{1};
  keyframes->keyframes.push_back({keyframe, SE3(Eigen::Quaterniond::Identity(), {0, 0, 1}), 1});
  auto map = std::make_shared<MapSnapshot>();
  map->keyframe_blocks.push_back(keyframes);
  constexpr float kPixel = 1.0F / 525;
  for (int first = 0; first < count; first += kBlockSlots) {
    auto patches = std::make_shared<PatchBlock>();
    auto positions = std::make_shared<PositionBlock>();
    for (int i = first; i < std::min(count, first + kBlockSlots); ++i) {
      const Eigen::Vector3f at(along(engine), along(engine), 0.1F * along(engine));
      const Eigen::Vector3f seen = at + Eigen::Vector3f::UnitZ();
      PointSource source;
      source.id = PointId{static_cast<uint64_t>(i) + 1};
      source.keyframe = keyframe;
      source.level = static_cast<uint8_t>(i % kPyramidLevels);
      source.ray_center = seen.normalized();
      const float pixel = kPixel * static_cast<float>(1 << source.level);
      source.ray_right = (seen + pixel * Eigen::Vector3f::UnitX()).normalized();
      source.ray_down = (seen + pixel * Eigen::Vector3f::UnitY()).normalized();
      patches->points.push_back(source);
      positions->positions.push_back(at);
      positions->visibility.push_back({-seen.normalized(), 0.9F, 0.7F, 1.3F});
      positions->live |= uint64_t{1} << (i - first);
    }
    map->point_blocks.push_back(make_point_block(patches, positions, map->keyframe_blocks));
  }
  return map;
}

/// Points of a whole map that are to be looked for in a frame that shows a quarter of it.
void BM_FindVisible(benchmark::State& state) {
  PointSearch search(desk().shared_camera(), PointSearchOptions());
  search.use_map(table_of_points(static_cast<int>(state.range(0))));
  std::vector<VisiblePoint> visible;
  const SE3 camera_from_map(so3_exp({0.2, 0.1, 0}), {0.1, 0, 0.9});
  for (auto _ : state) search.find_visible(camera_from_map, 1000, &visible);
  state.counters["visible"] = static_cast<double>(visible.size());
}
BENCHMARK(BM_FindVisible)->Arg(1000)->Arg(3000)->Arg(10000)->Arg(30000)->Arg(100000);

void BM_TinyImage(benchmark::State& state) {
  FrameImages images = prepare();
  for (auto _ : state) images.build_tiny();
}
BENCHMARK(BM_TinyImage);

/// Aligns the tiny images of this frame and one a tenth of a second later.
void BM_AlignTiny(benchmark::State& state) {
  constexpr int kLater = 3;
  FrameImages later;
  const GrayImage image = desk().frame(kFrame + kLater).image;
  later.build_pyramid(image.view());
  later.build_tiny();
  for (auto _ : state) benchmark::DoNotOptimize(align_tiny(prepared().tiny, later.tiny));
}
BENCHMARK(BM_AlignTiny);

/// Describes a place whose corners are already found.
void BM_DescribePlace(benchmark::State& state) {
  const auto& corners = prepared().all_corners();
  size_t described = 0;
  for (auto _ : state) described = describe_place(prepared().pyramid, corners).corners.size();
  state.counters["corners"] = static_cast<double>(described);
}
BENCHMARK(BM_DescribePlace);

/// Describes the same corners by OpenCV's ORB.
void BM_OrbOfOpenCv(benchmark::State& state) {
  cv::setNumThreads(1);
  const cv::Mat image = as_mat(frame().view());
  const auto orb = cv::ORB::create(1000, 2.0F, kPyramidLevels);
  std::vector<cv::KeyPoint> corners;
  for (const PlaceCorner& c : describe_place(prepared().pyramid, prepared().all_corners()).corners) {
    const float size = 31.0F * static_cast<float>(1 << c.level);
    corners.emplace_back(c.pixel.x(), c.pixel.y(), size, 0.0F, 0.0F, c.level);
  }
  cv::Mat descriptors;
  std::vector<cv::KeyPoint> described;
  for (auto _ : state) {
    described = corners;
    orb->compute(image, described, descriptors);
  }
  state.counters["corners"] = static_cast<double>(described.size());
}
BENCHMARK(BM_OrbOfOpenCv);

void BM_SimulatedFrame(benchmark::State& state) {
  Simulator simulator = desk();
  int index = 0;
  for (auto _ : state) benchmark::DoNotOptimize(simulator.frame(index++ % simulator.frame_count()));
}
BENCHMARK(BM_SimulatedFrame)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn

BENCHMARK_MAIN();
