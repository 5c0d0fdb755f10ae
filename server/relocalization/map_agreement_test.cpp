// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/map_agreement.h"

#include <gtest/gtest.h>

#include <random>

namespace cairn {
namespace {

constexpr unsigned kSeed = 5;
constexpr double kDepth = 2;  ///< [unit of the one map]

class MapAgreementTest : public ::testing::Test {
 protected:
  [[nodiscard]] double number(double most) {
    return std::uniform_real_distribution<double>(-most, most)(random_);
  }
  [[nodiscard]] Eigen::Vector3d vector(double most) { return {number(most), number(most), number(most)}; }
  [[nodiscard]] SE3 camera() { return {so3_exp(vector(0.5)), vector(1)}; }
  [[nodiscard]] Similarity3 similarity() { return {std::exp(number(1)), so3_exp(vector(3)), vector(5)}; }
  [[nodiscard]] SharedView seen_from(const SE3& camera, const Similarity3& other_from_one) const {
    return {camera, other_from_one.transform_camera(camera), kDepth, kDepth * other_from_one.scale()};
  }
  /// A pose that is off by some of what is seen, as a relocalizer's.
  [[nodiscard]] SharedView inexact(SharedView view, double share) {
    view.camera_from_other =
        SE3(so3_exp(vector(share / 2)), vector(share / 2 * view.depth_in_other)) * view.camera_from_other;
    return view;
  }

  std::mt19937_64 random_{kSeed};
};

void expect_same(const Similarity3& a, const Similarity3& b, double tolerance) {
  EXPECT_NEAR(a.scale() / b.scale(), 1, tolerance);
  EXPECT_LT(a.rotation().angularDistance(b.rotation()), tolerance);
  EXPECT_LT((a.translation() - b.translation()).norm() / b.scale(), 4 * tolerance);
}

TEST_F(MapAgreementTest, ViewsOfOnePlaceTellHowItsMapsLieToEachOther) {
  for (int round = 0; round < 50; ++round) {
    SCOPED_TRACE(round);
    const Similarity3 truth = similarity();
    std::vector<SharedView> views;
    views.reserve(4);
    for (int i = 0; i < 4; ++i) views.push_back(seen_from(camera(), truth));
    const auto found = find_agreement(views, MapAgreementOptions());
    ASSERT_TRUE(found);
    EXPECT_EQ(found->views, (std::vector<size_t>{0, 1, 2, 3}));
    expect_same(found->other_from_one, truth, 1e-9);
  }
}

TEST_F(MapAgreementTest, InexactOnesAgreeAndWrongOnesDoNot) {
  for (int round = 0; round < 50; ++round) {
    SCOPED_TRACE(round);
    const Similarity3 truth = similarity();
    std::vector<SharedView> views;
    std::vector<size_t> right;
    for (size_t i = 0; i < 9; ++i) {
      const bool is_right = i % 3 != 1;
      views.push_back(inexact(seen_from(camera(), is_right ? truth : similarity()), 0.02));
      if (is_right) right.push_back(i);
    }
    const auto found = find_agreement(views, MapAgreementOptions());
    ASSERT_TRUE(found);
    EXPECT_EQ(found->views, right);
    expect_same(found->other_from_one, truth, 0.1);
  }
}

TEST_F(MapAgreementTest, ImagesOfSeveralPlacesAgreeInNothing) {
  size_t most = 0;
  for (int round = 0; round < 50; ++round) {
    std::vector<SharedView> views;
    views.reserve(8);
    for (int i = 0; i < 8; ++i) views.push_back(seen_from(camera(), similarity()));
    const auto found = find_agreement(views, MapAgreementOptions());
    if (found) most = std::max(most, found->views.size());
  }
  EXPECT_LT(most, 3U);
}

TEST_F(MapAgreementTest, OneScaleFitsAll) {
  const Similarity3 truth = similarity();
  std::vector<SharedView> views;
  for (const double x : {0.0, 1.0, 3.0})
    views.push_back(seen_from(SE3(Eigen::Quaterniond::Identity(), {x, 0, 0}), truth));
  ASSERT_TRUE(find_agreement(views, MapAgreementOptions()));
  EXPECT_EQ(find_agreement(views, MapAgreementOptions())->views.size(), 3U);
  // The third stands where it would if the map were half as large, with the right rotation.
  const SE3& third = views[2].camera_from_other;
  const Eigen::Vector3d shorter = (views[0].camera_from_other.center() + third.center()) / 2;
  views[2].camera_from_other = SE3(third.rotation(), -(third.rotation() * shorter));
  EXPECT_EQ(find_agreement(views, MapAgreementOptions())->views.size(), 2U);
}

TEST_F(MapAgreementTest, ViewsFromOnePlaceSayNothingOfTheScale) {
  const Similarity3 truth = similarity();
  std::vector<SharedView> views;
  for (int i = 0; i < 5; ++i) {
    const Eigen::Quaterniond turned = so3_exp(vector(0.5));
    views.push_back(seen_from(SE3(turned, turned * vector(0.01)), truth));
  }
  EXPECT_FALSE(find_agreement(views, MapAgreementOptions()));
  EXPECT_FALSE(find_agreement({}, MapAgreementOptions()));
  EXPECT_FALSE(find_agreement(std::vector{views[0]}, MapAgreementOptions()));
}

TEST_F(MapAgreementTest, WhoWalkedTheOtherWayWasNotThere) {
  const Similarity3 truth = similarity();
  std::vector<SharedView> views;
  for (const double x : {0.0, 1.0, 2.0})
    views.push_back(seen_from(SE3(Eigen::Quaterniond::Identity(), {x, 0, 0}), truth));
  std::swap(views[0].camera_from_other, views[2].camera_from_other);
  EXPECT_FALSE(find_agreement(views, MapAgreementOptions()));
}

}  // namespace
}  // namespace cairn
