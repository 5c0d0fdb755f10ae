// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/trails.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <vector>

#include "client/tracking/plane_scene.h"
#include "client/tracking/trail_pose.h"
#include "common/base/median.h"
#include "common/geometry/triangulation.h"
#include "common/geometry/two_view.h"

namespace cairn {
namespace {

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, 0, 0, 0, 0}});
}

/// One metre above the plane, looking down and ahead by `tilt` [rad].
SE3 looking_down(double x, double y, double height = 1.0, double tilt = 0.4) {
  const Eigen::Matrix3d down = (Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished();
  const Eigen::Quaterniond camera_from_map =
      Eigen::Quaterniond(Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX())) * Eigen::Quaterniond(down);
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, height))};
}

/// A camera on its way over a plane, its trails followed frame by frame.
class Trails : public ::testing::Test {
 protected:
  using Way = std::function<SE3(int frame)>;

  /// The frame of the first proposal, or -1.
  int follow(const Way& way, int frames) {
    for (int i = 0; i < frames; ++i) {
      show(way(i));
      proposal = follower.propose(image, Timestamp{i}, images[current]);
      if (proposal) return i;
    }
    return -1;
  }
  void show(const SE3& pose) {
    image = scene.render(pose);
    current = 1 - current;
    FrameImages& now = images[current];
    FrameImages& previous = images[1 - current];
    now.build_pyramid(image->view());
    now.build_tiny();
    const TinyMotion seen = previous.tiny.empty() ? TinyMotion{} : align_tiny(previous.tiny, now.tiny);
    follower.follow(image, {}, now, previous, seen);
  }
  static TrailOptions options() {
    TrailOptions o;
    o.count = 400;
    return o;
  }

  CameraPtr camera = test_camera();
  test::PlaneScene scene{11, camera};
  TrailFollower follower{camera, 1, options()};
  std::array<FrameImages, 2> images;
  size_t current = 0;
  GrayImagePtr image;
  std::optional<SeedProposal> proposal;
};

/// Angle between the baselines of two motions [rad].
double direction_error(const SE3& motion, const SE3& truth) {
  const double cosine = motion.translation().normalized().dot(truth.translation().normalized());
  return std::acos(std::clamp(cosine, -1.0, 1.0));
}

/// Straight or bent, quick or slow: the motion that is proposed is the camera's, to the sigma that is asked.
TEST_F(Trails, TheMotionProposedIsTheCamerasWhateverTheWay) {
  const std::vector<std::pair<const char*, Way>> ways = {
      {"aside", [](int i) { return looking_down(0.008 * i, 0); }},
      {"bent",
       [](int i) { return looking_down(0.15 * std::sin(0.05 * i), 0.15 * (1 - std::cos(0.05 * i))); }},
      {"quick", [](int i) { return looking_down(0.03 * i, 0.02 * i * i / 10.0); }},
      {"slow", [](int i) { return looking_down(0.0015 * i, 0.0005 * std::sin(0.1 * i)); }},
  };
  for (const auto& [name, way] : ways) {
    follower.restart();
    const int last = follow(way, 200);
    ASSERT_GE(last, 2) << name << ": " << follower.note();
    const SE3 truth = way(last) * way(0).inverse();
    EXPECT_LT(direction_error(proposal->second_from_first, truth), 5 * M_PI / 180) << name;
    EXPECT_LT(proposal->second_from_first.rotation().angularDistance(truth.rotation()), 1 * M_PI / 180)
        << name;
    EXPECT_NEAR(proposal->second_from_first.translation().norm(), 1, 1e-9) << name;
    follower.refused("by the test");
  }
}

/// Sharp images leave the depths known at less parallax than two views alone need, unless the camera turns:
/// a calibration or a shutter that is a little wrong spoils them then, and no noise tells.
TEST_F(Trails, ALittleParallaxIsEnoughWhereNeitherNoiseNorATurnSpoilsTheDepths) {
  constexpr double kTwoViews = 1.2 * M_PI / 180;  // what two views alone need
  const auto seen_apart_at_start = [this](double roll) {
    follower.restart();
    const Way way = [roll](int i) {
      return SE3(so3_exp({0, 0, roll * i}), Eigen::Vector3d::Zero()) * looking_down(0.0015 * i, 0.0005 * i);
    };
    const int last = follow(way, 100);
    if (last < 0) return 0.0;
    const SE3 back = way(0).inverse();
    std::vector<double> angles;
    for (const Trail& t : proposal->trails) {
      const Eigen::Vector3d down = back.rotation() * camera->unproject(t.first.cast<double>());
      const Eigen::Vector3d point = back.translation() - down * (back.translation().z() / down.z());
      angles.push_back(parallax(point, back.translation(), way(last).center()));
    }
    follower.refused("by the test");
    return reorder_to_median(std::span(angles));
  };
  const double straight = seen_apart_at_start(0);
  EXPECT_GT(straight, 0.9 * kLeastMapParallax);
  EXPECT_LT(straight, 0.85 * kTwoViews);
  EXPECT_GT(seen_apart_at_start(0.02), 0.9 * kTwoViews);
}

/// A way of more remembered positions than are kept is thinned out, and its trails end where they should.
TEST_F(Trails, ALongWayIsThinnedOutAndStaysInStep) {
  const auto way = [](int i) { return looking_down(0.0025 * i, 0.0005 * i); };
  ASSERT_GE(follow(way, 100), 0) << follower.note();
  int last = 0;
  for (int i = 101; i < 150; ++i) {
    show(way(last = i));  // undecided: trails go on, 100 px in all
    ASSERT_FALSE(follower.propose(image, Timestamp{i}, images[current])) << "while one is undecided";
  }
  follower.refused("by the test");
  show(way(++last));
  proposal = follower.propose(image, Timestamp{last}, images[current]);
  ASSERT_TRUE(proposal) << follower.note();
  EXPECT_LT(direction_error(proposal->second_from_first, way(last) * way(0).inverse()), 2 * M_PI / 180);
}

TEST_F(Trails, AfterARefusalOnlyMoreMovementIsProposed) {
  const auto way = [](int i) { return looking_down(0.004 * i, 0.001 * i); };
  const int first = follow(way, 100);
  ASSERT_GE(first, 0);
  EXPECT_TRUE(follower.is_undecided());
  follower.refused("no parallax");
  EXPECT_FALSE(follower.is_undecided());
  EXPECT_NE(follower.note().find("no parallax"), std::string::npos);
  show(way(first));
  EXPECT_FALSE(follower.propose(image, {}, images[current])) << "the same view again";
  int again = first;
  for (proposal.reset(); !proposal && again < 2 * first + 20;) {
    show(way(++again));
    proposal = follower.propose(image, {}, images[current]);
  }
  ASSERT_TRUE(proposal);
  EXPECT_GT(again * 1.0, first * 1.1);
}

TEST_F(Trails, TurningAndStandingProposeNothingAndSayWhy) {
  SE3 here = looking_down(0, 0);
  EXPECT_EQ(follow(
                [&](int i) {
                  return SE3(so3_exp({0.004 * i, 0.01 * i, 0}), Eigen::Vector3d::Zero()) * here;
                },
                20),
            -1);
  EXPECT_NE(follower.note().find("turned"), std::string::npos) << follower.note();
  follower.restart();
  EXPECT_EQ(follow([&](int) { return here; }, 5), -1);
  EXPECT_NE(follower.note().find("no parallax yet"), std::string::npos) << follower.note();
}

/// Where too few trails are left they begin anew, in that frame.
TEST_F(Trails, WhatIsLostBeginsAnew) {
  show(looking_down(0, 0));
  show(looking_down(0.01, 0));
  ASSERT_GT(follower.live().size(), 60U);
  const TrailId before = follower.live().front().id;
  show(looking_down(0.8, 0.5));
  ASSERT_GT(follower.live().size(), 60U);
  EXPECT_GT(follower.live().front().id, before);
}

/// The pose in a map that was made from trails, from where these are by then.
TEST_F(Trails, TheirPoseInTheMapIsTheCameras) {
  const SE3 first = looking_down(0, 0);
  const MapSnapshotPtr map = scene.make_map(first);
  show(first);
  SeedAnswer seed;
  seed.map = map->map;
  seed.second_keyframe = KeyframeId{1};
  for (const auto& trail : follower.live()) {  // points of the map at the corners where trails began
    for (size_t b = 0; b < map->point_blocks.size(); ++b) {
      const PointBlock& block = *map->point_blocks[b];
      for (int slot = 0; slot < block.count; ++slot) {
        const auto pixel = camera->project(first * block.position(slot));
        if (pixel && (pixel->cast<float>() - trail.now).norm() < 0.3F)
          seed.points.emplace_back(trail.id, block.ids[static_cast<size_t>(slot)]);
      }
    }
  }
  ASSERT_GT(seed.points.size(), 40U);
  SE3 truth;
  for (int i = 1; i <= 10; ++i) show(truth = looking_down(0.01 * i, 0.003 * i));
  const auto pose = pose_from_trails(*camera, *map, seed, follower.live(), 1, TrailPoseOptions());
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->center() - truth.center()).norm(), 3e-3);

  seed.points.resize(15);
  EXPECT_FALSE(pose_from_trails(*camera, *map, seed, follower.live(), 1, TrailPoseOptions())) << "too few";
}

}  // namespace
}  // namespace cairn
