// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/third_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace cairn {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kPoints = 250;

/// A tilted plane seen in a forward motion, which two views explain in two ways, and the same points on the
/// way.
class PlaneOnTheWay {
 public:
  /// `bend`: how far the middle of the way lies beside the straight line, over the baseline.
  PlaneOnTheWay(unsigned seed, double bend, double noise) : random_(seed), noise_(noise) {
    camera_ = make_camera({CameraModel::kPinholeRadtan, 384, 288, {380, 380, 191.5, 143.5}}).value();
    const Eigen::Vector3d along = Eigen::Vector3d(normal(), normal(), normal()).normalized();
    const Eigen::Vector3d beside = along.cross(Eigen::Vector3d(normal(), normal(), normal())).normalized();
    const Eigen::Vector3d turn = 3 * kDegree * Eigen::Vector3d(normal(), normal(), normal()).normalized();
    constexpr double kBaseline = 4 * kDegree;  // as parallax at depth 1
    std::vector<SE3> poses;
    for (const double way : {0.25, 0.5, 0.75, 1.0}) {
      const double off = bend * std::sin(std::numbers::pi * way);
      poses.emplace_back(so3_exp(way * turn), kBaseline * (way * along + off * beside));
      if (way < 1) views_.push_back({way, {}});
    }
    b_from_a_ = poses.back();
    while (matches_.size() < kPoints) add_point(poses);
  }

  [[nodiscard]] auto motions() const {
    TwoViewOptions options;
    options.sigma = 0.7;
    return find_motions(*camera_, *camera_, matches_, options);
  }
  [[nodiscard]] MotionChoice choose(const std::vector<SE3>& motions) const {
    return choose_motion(*camera_, matches_, motions, views_, 0.7);
  }
  [[nodiscard]] bool is_true(const SE3& motion) const {
    return motion.translation().dot(b_from_a_.translation().normalized()) > std::cos(20 * kDegree) &&
           motion.rotation().angularDistance(b_from_a_.rotation()) < 1 * kDegree;
  }
  std::vector<ThirdView>& views() { return views_; }

 private:
  double normal() { return normal_(random_); }
  Eigen::Vector2d noise() { return noise_ * Eigen::Vector2d(normal(), normal()); }

  void add_point(const std::vector<SE3>& poses) {
    std::uniform_real_distribution<double> x(0, camera_->width() - 1);
    std::uniform_real_distribution<double> y(0, camera_->height() - 1);
    const Eigen::Vector2d pixel(x(random_), y(random_));
    const Eigen::Vector3d ray = camera_->unproject(pixel);
    const Eigen::Vector3d point = ray / Eigen::Vector3d(0, std::sin(0.6), std::cos(0.6)).dot(ray);
    std::vector<Eigen::Vector2d> seen;
    for (const SE3& pose : poses) {
      const auto projected = camera_->project(pose * point);
      if (!projected || !camera_->in_image(*projected)) return;
      seen.push_back(*projected + noise());
    }
    matches_.push_back({pixel + noise(), seen.back()});
    for (size_t i = 0; i < views_.size(); ++i) views_[i].pixels.push_back(seen[i]);
  }

  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  double noise_;
  CameraPtr camera_;
  SE3 b_from_a_;
  std::vector<PixelMatch> matches_;
  std::vector<ThirdView> views_;
};

struct Endings {
  int ambiguous = 0;  ///< pairs whose two views leave more than one motion, the true one among them
  int right = 0;
  int wrong = 0;
};

Endings endings(double bend, double noise) {
  Endings result;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    const PlaneOnTheWay plane(seed, bend, noise);
    const auto motions = plane.motions();
    if (!motions || motions->decided) continue;
    if (std::none_of(motions->b_from_a.begin(), motions->b_from_a.end(),
                     [&](const SE3& m) { return plane.is_true(m); }))
      continue;
    ++result.ambiguous;
    const MotionChoice choice = plane.choose(motions->b_from_a);
    if (!choice.decided) continue;
    ++(plane.is_true(motions->b_from_a[choice.best]) ? result.right : result.wrong);
  }
  return result;
}

TEST(ThirdView, AWayThatBendsTellsTheMotionsOfAPlaneApart) {
  for (const double noise : {0.05, 0.2}) {
    const Endings result = endings(0.5, noise);
    EXPECT_GE(result.ambiguous, 20) << "the test's pairs are not ambiguous, noise " << noise;
    EXPECT_GE(result.right, result.ambiguous * 8 / 10) << "noise " << noise;
    EXPECT_LE(result.wrong, result.ambiguous / 20) << "noise " << noise;
  }
}

TEST(ThirdView, AStraightWayInNoiseIsLeftUndecidedRatherThanGuessed) {
  const Endings result = endings(0, 0.5);
  EXPECT_GE(result.ambiguous, 20);
  EXPECT_LE(result.wrong, result.ambiguous / 20);
  EXPECT_LT(result.right, result.ambiguous);
}

/// A start is refused where they do: that must not happen by chance.
TEST(ThirdView, WhereTwoViewsDecideForTheTrueMotionTheWayDoesNotContradict) {
  int decided = 0;
  int contradicted = 0;
  for (unsigned seed = 1; seed <= 200; ++seed) {
    for (const double bend : {0.0, 0.5}) {
      const PlaneOnTheWay plane(seed, bend, 0.1);
      const auto motions = plane.motions();
      if (!motions || !motions->decided || motions->b_from_a.size() < 2) continue;
      ++decided;
      const MotionChoice choice = plane.choose(motions->b_from_a);
      contradicted += choice.decided && choice.best != 0 && plane.is_true(motions->b_from_a[0]) ? 1 : 0;
    }
  }
  EXPECT_GE(decided, 20);
  EXPECT_LE(contradicted, decided / 50);
}

TEST(ThirdView, OrderOfTheMotionsDoesNotMatter) {
  int tried = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    const PlaneOnTheWay plane(seed, 0.5, 0.1);
    const auto motions = plane.motions();
    if (!motions || motions->b_from_a.size() < 2) continue;
    ++tried;
    const size_t count = motions->b_from_a.size();
    const MotionChoice forward = plane.choose(motions->b_from_a);
    const MotionChoice backward = plane.choose({motions->b_from_a.rbegin(), motions->b_from_a.rend()});
    EXPECT_EQ(forward.best, count - 1 - backward.best) << "seed " << seed;
    EXPECT_EQ(forward.decided, backward.decided) << "seed " << seed;
    for (size_t i = 0; i < count; ++i)
      EXPECT_EQ(forward.cost[i], backward.cost[count - 1 - i]) << "seed " << seed;
  }
  EXPECT_GT(tried, 0);
}

TEST(ThirdView, NothingIsDecidedWithoutViewsOrPoints) {
  PlaneOnTheWay plane(1, 0.5, 0.1);
  const SE3 motion = plane.motions()->b_from_a[0];
  const std::vector<SE3> motions{motion, SE3(motion.rotation(), -motion.translation())};
  for (ThirdView& view : plane.views()) {
    std::fill(view.pixels.begin(), view.pixels.end(),
              Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
  }
  EXPECT_FALSE(plane.choose(motions).decided);
  plane.views().clear();
  EXPECT_FALSE(plane.choose(motions).decided);
}

}  // namespace
}  // namespace cairn
