// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/certainty.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/relocalization/exact_map.h"

namespace cairn {
namespace {

using testing::describe_image;
using testing::error_of;
using testing::ExactMap;
using testing::Scene;

class CertaintyTest : public ::testing::Test {
 protected:
  /// All that is found around a pose that is right.
  [[nodiscard]] Refined refined_at_truth() const {
    return *refine(view_, grid_, *scene_.camera(), *index_, 1, as_certain(truth_), RefineOptions(),
                   MatchOptions());
  }

  Scene scene_{11};
  ExactMap map_{scene_, 1, {0, 4, 8}};
  IndexedMapPtr index_ = map_.index();
  SE3 truth_ = Scene::pose(5);
  PlaceView view_ = describe_image(scene_.render(truth_, 20261126)->view());
  CornerGrid grid_{view_, *scene_.camera()};
};

TEST_F(CertaintyTest, ManyPointsInOnePartOfTheImageSayNoMoreThanOne) {
  Refined some = refined_at_truth();
  const double all_about = position_sigma(view_, *scene_.camera(), some);
  Refined twice = some;
  twice.guided.matches.insert(twice.guided.matches.end(), some.guided.matches.begin(),
                              some.guided.matches.end());
  twice.pose.weights.insert(twice.pose.weights.end(), some.pose.weights.begin(), some.pose.weights.end());
  EXPECT_NEAR(position_sigma(view_, *scene_.camera(), twice), all_about, 1e-9 * all_about);
  for (size_t i = 0; i < some.pose.weights.size(); ++i) {
    const float x = view_.corners[some.guided.matches[i].corner].pixel.x();
    if (x > static_cast<float>(scene_.camera()->width()) / 2) some.pose.weights[i] = 0;
  }
  EXPECT_GT(position_sigma(view_, *scene_.camera(), some), all_about) << "one half only";
}

TEST_F(CertaintyTest, WhatNothingDeterminesIsOpenWithoutEnd) {
  EXPECT_TRUE(std::isinf(position_sigma(view_, *scene_.camera(), Refined{as_certain(truth_), {}, {}})));
}

TEST_F(CertaintyTest, APoseThatIsNotTheBestIsLeftForTheBest) {
  Refined held = refined_at_truth();
  const Eigen::Vector3d aside(0.05 * held.points.points.front().depth, 0, 0);
  held.pose.camera_from_map = SE3(Eigen::Quaterniond::Identity(), aside) * truth_;
  for (double& weight : held.pose.weights) weight *= 0.3;  // as if it explained less
  ASSERT_GT(error_of(held.pose.camera_from_map, truth_, *map_.snapshot()), 0.02);
  const Refined settled = settle(view_, grid_, *scene_.camera(), *index_, 1, held, aside.x() / 0.05,
                                 SettleOptions(), RefineOptions(), MatchOptions());
  EXPECT_LT(error_of(settled.pose.camera_from_map, truth_, *map_.snapshot()), 0.01);
}

}  // namespace
}  // namespace cairn
