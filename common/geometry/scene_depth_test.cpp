// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/scene_depth.h"

#include <gtest/gtest.h>

#include <numeric>

namespace cairn {
namespace {

TEST(SceneDepth, IsTheMeanWhereNothingIsFarBehindTheRest) {
  std::vector<double> depths = {3, 1, 2, 2.5, 7, 1.5};
  const double mean = std::accumulate(depths.begin(), depths.end(), 0.0) / 6;
  EXPECT_NEAR(scene_depth(&depths), mean, 1e-12);
}

TEST(SceneDepth, WhereTheFarthestStandIsOfNoMatter) {
  const auto with_far = [](double far) {
    std::vector<double> depths(90, 2.0);
    depths.insert(depths.begin() + 40, 10, far);
    return scene_depth(&depths);
  };
  EXPECT_NEAR(with_far(1e3), with_far(1e7), 1e-12);
  EXPECT_LT(with_far(1e7), 3) << "a tenth at infinity";
  EXPECT_GT(with_far(1e7), 2);
}

TEST(SceneDepth, GoesWithTheUnit) {
  std::vector<float> metres = {0.5F, 1, 3, 40, 2};
  std::vector<float> feet = metres;
  for (float& d : feet) d *= 4;
  EXPECT_NEAR(scene_depth(&feet), 4 * scene_depth(&metres), 1e-5);
  std::vector<float> none;
  EXPECT_EQ(scene_depth(&none), 0);
}

}  // namespace
}  // namespace cairn
