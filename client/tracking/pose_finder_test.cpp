// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/pose_finder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "client/tracking/plane_scene.h"
#include "client/tracking/tracker.h"

namespace cairn {
namespace {

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02}});
}

/// A camera one metre above the plane, looking down at (x, y).
SE3 looking_down(double x, double y) {
  const Eigen::Quaterniond down(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX()));
  return {down, -(down * Eigen::Vector3d(x, y, 1))};
}

double center_distance(const SE3& a, const SE3& b) {
  return (a.center() - b.center()).norm();
}

class CornerProbe : public StageProbe {
 public:
  void begin(Stage stage) override { asked += stage == Stage::kCorners ? 1 : 0; }
  void end(Stage /*stage*/) override {}
  int asked = 0;
};

/// The corners of the two large levels cost a quarter of a frame's time.
TEST(PoseFinder, AsksForAllCornersOnlyWhereAlignmentFindsTooFew) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  const TrackerOptions options;
  const SE3 truth = looking_down(0.05, 0.01);
  const SE3 start = SE3(so3_exp({0.001, -0.001, 0.002}), {0.001, 0, -0.001}) * truth;
  const auto ask = [&](const GrayImage& image, const SearchEffort& effort) {
    PoseFinder finder(camera, options);
    finder.use_map(scene.make_map(looking_down(0, 0)));
    FrameImages frame;
    frame.build_pyramid(image.view());
    CornerProbe probe;
    const auto pose = finder.locate(frame, start, effort, &probe);
    EXPECT_TRUE(pose);
    EXPECT_LT(center_distance(pose.value_or(start), truth), 1e-3);
    return probe.asked;
  };
  const GrayImagePtr image = scene.render(truth);
  GrayImage covered(image->view());  // three quarters of it
  for (int y = 0; y < covered.height(); ++y)
    std::fill_n(covered.row(y) + covered.width() / 4, covered.width() - covered.width() / 4, uint8_t{0});
  constexpr int kCoarseOnly = 1;
  EXPECT_EQ(ask(*image, normal_effort(options)), kCoarseOnly);
  EXPECT_EQ(ask(covered, normal_effort(options)), kCoarseOnly + 1);
  SearchEffort verifying = normal_effort(options);
  verifying.enough_aligned = 1;
  EXPECT_EQ(ask(*image, verifying), kCoarseOnly + 1);
}

/// What is near is near although a hand, or the dark, lets only what is far be found.
TEST(PoseFinder, HowNearThingsAreDoesNotDependOnWhatIsFound) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  const SE3 truth = SE3(so3_exp({0.5, 0, 0}), {0, 0, 0}) * looking_down(0, 0);  // the near half above
  const GrayImagePtr image = scene.render(truth);
  GrayImage covered(image->view());
  for (int y = 0; y < covered.height() / 2; ++y) std::fill_n(covered.row(y), covered.width(), uint8_t{0});
  const TrackerOptions options;
  const auto seen = [&](const GrayImage& shown) {
    PoseFinder finder(camera, options);
    finder.use_map(scene.make_map(truth));
    FrameImages frame;
    frame.build_pyramid(shown.view());
    EXPECT_TRUE(finder.locate(frame, truth, normal_effort(options), nullptr));
    return std::pair{finder.near_depth().value_or(0), finder.mean_depth().value_or(0)};
  };
  const auto [near_depth, mean_depth] = seen(*image);
  const auto [near_when_covered, mean_when_covered] = seen(covered);
  EXPECT_GT(mean_when_covered, 1.1 * mean_depth) << "only what is far is found";
  EXPECT_NEAR(near_when_covered, near_depth, 0.02 * near_depth);
}

/// Mean of the square around each pixel: what the two top levels of a pyramid show.
std::vector<float> large_things(const GrayImage& image) {
  constexpr int kReach = 4;  // [px]
  std::vector<float> mean;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      float sum = 0;
      int count = 0;
      for (int v = std::max(0, y - kReach); v < std::min(image.height(), y + kReach); ++v) {
        for (int u = std::max(0, x - kReach); u < std::min(image.width(), x + kReach); ++u) {
          sum += image.row(v)[u];
          ++count;
        }
      }
      mean.push_back(sum / static_cast<float>(count));
    }
  }
  return mean;
}

/// The small things of one shown among the large ones of another.
GrayImage small_among_large(const GrayImage& small, const GrayImage& large) {
  GrayImage mixed(small.view());
  const auto own = large_things(small);
  const auto other = large_things(large);
  size_t i = 0;
  for (int y = 0; y < mixed.height(); ++y) {
    for (int x = 0; x < mixed.width(); ++x, ++i) {
      const float value = static_cast<float>(small.row(y)[x]) - own[i] + other[i];
      mixed.row(y)[x] = static_cast<uint8_t>(std::clamp(value, 0.0F, 255.0F));
    }
  }
  return mixed;
}

/// Between keys that look alike a dozen large points agree on one that is the wrong one. Then the many small
/// ones, where they were expected, know better.
TEST(PoseFinder, TheCoarseStageIsNotBelievedAgainstThePointsThatItLeadsAstray) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  const TrackerOptions options;
  const SE3 truth = looking_down(0.05, 0.01);
  const SE3 astray = looking_down(0.09, 0.01);  // 10 px
  const GrayImage mixed = small_among_large(*scene.render(truth), *scene.render(astray));
  FrameImages frame;
  frame.build_pyramid(mixed.view());
  const auto error = [&](const SearchEffort& effort) {
    PoseFinder finder(camera, options);
    finder.use_map(scene.make_map(looking_down(0, 0)));
    return center_distance(finder.locate(frame, truth, effort, nullptr).value_or(SE3()), truth);
  };
  SearchEffort believing = normal_effort(options);
  believing.doubts_coarse = false;
  EXPECT_GT(error(believing), 0.02) << "else this tests nothing";
  EXPECT_LT(error(normal_effort(options)), 2e-3);
}

/// What it leads to may pass for good, and be much less than was found a frame before.
TEST(PoseFinder, TheCoarseStageIsDoubtedWhereMuchLessIsFoundThanExpected) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  TrackerOptions options;
  options.good_quality = 0;  // everything is good
  const SE3 truth = looking_down(0.05, 0.01);
  const GrayImage mixed = small_among_large(*scene.render(truth), *scene.render(looking_down(0.09, 0.01)));
  FrameImages frame;
  frame.build_pyramid(mixed.view());
  const auto error = [&](float expected_quality) {
    PoseFinder finder(camera, options);
    finder.use_map(scene.make_map(looking_down(0, 0)));
    SearchEffort effort = normal_effort(options);
    effort.expected_quality = expected_quality;
    return center_distance(finder.locate(frame, truth, effort, nullptr).value_or(SE3()), truth);
  };
  EXPECT_GT(error(0), 0.02) << "else this tests nothing";
  EXPECT_LT(error(0.9F), 2e-3);
}

/// What it finds by the coarse stage, poor as it is, stays when nothing better is found without.
TEST(PoseFinder, TheBetterOfTwoLooksStays) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  TrackerOptions options;
  options.good_quality = 1.01F;    // nothing is good
  options.finder.fine_radius = 2;  // without a coarse stage it finds nothing there
  const SE3 truth = looking_down(0.05, 0.01);
  const SE3 start = looking_down(0.08, 0.01);  // 8 px
  FrameImages frame;
  frame.build_pyramid(scene.render(truth)->view());
  PoseFinder finder(camera, options);
  finder.use_map(scene.make_map(looking_down(0, 0)));
  const auto pose = finder.locate(frame, start, normal_effort(options), nullptr);
  ASSERT_TRUE(pose);
  EXPECT_LT(center_distance(*pose, truth), 1e-3);
  EXPECT_EQ(finder.found(), std::ranges::count_if(finder.points(), &VisiblePoint::found));
  EXPECT_GT(finder.quality(), 0.5F);
  PoseFinder once(camera, options);
  once.use_map(scene.make_map(looking_down(0, 0)));
  SearchEffort believing = normal_effort(options);
  believing.doubts_coarse = false;
  ASSERT_TRUE(once.locate(frame, start, believing, nullptr));
  EXPECT_EQ(finder.covariance(), once.covariance()) << "is that of the look that stays";
}

/// The points of a map, each off its place by some pixels in another direction: all are found, and no pose
/// puts them where they are.
TEST(PoseFinder, WhatDoesNotFitIsNoPoseHoweverMuchOfItIsFound) {
  const CameraPtr camera = test_camera();
  const test::PlaneScene scene(3, camera);
  const TrackerOptions options;
  const SE3 truth = looking_down(0.05, 0.01);
  FrameImages frame;
  frame.build_pyramid(scene.render(truth)->view());
  const auto located = [&](float off) {
    auto map = std::make_shared<MapSnapshot>(*scene.make_map(looking_down(0, 0)));
    std::mt19937 random(5);
    std::uniform_real_distribution<float> offset(-off, off);
    for (auto& block : map->point_blocks) {
      auto positions = std::make_shared<PositionBlock>(*block->positions);
      for (Eigen::Vector3f& p : positions->positions) p += Eigen::Vector3f(offset(random), offset(random), 0);
      block = make_point_block(block->patches, positions, map->keyframe_blocks);
    }
    PoseFinder finder(camera, options);
    finder.use_map(map);
    const bool is_found = finder.locate(frame, truth, wide_effort(options), nullptr).has_value();
    EXPECT_EQ(finder.found(), std::ranges::count_if(finder.points(), &VisiblePoint::found));
    EXPECT_GT(finder.points().size(), 100U);
    return is_found && finder.judge() != PoseVerdict::kBad;
  };
  EXPECT_TRUE(located(0.002F));  // 0.5 px
  EXPECT_FALSE(located(0.03F));  // 8 px
}

}  // namespace
}  // namespace cairn
