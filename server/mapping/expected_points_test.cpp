// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/expected_points.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "server/mapping/map_maker_fixture.h"

namespace cairn {
namespace {

using testing::make_offer;
using testing::Scene;

constexpr size_t kAll = 100'000;

class ExpectedPointsTest : public testing::MapMakerFixture {
 protected:
  void SetUp() override {
    start();
    work();
    ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
    map_ = maker_->snapshot();
  }
  /// Of the map, in the view that `scene` gives from a step; `aside`: the pose is off by that [map unit].
  [[nodiscard]] std::vector<ExpectedPoint> look(const Scene& scene, int step, double aside = 0,
                                                size_t most = kAll) const {
    const KeyframeInput view = make_offer(scene, *map_, step, scene.render(Scene::pose(step), 77));
    SE3 pose = view.camera_from_reference * map_->find(view.reference)->camera_from_map;
    pose = SE3(Eigen::Quaterniond::Identity(), {aside, 0, 0}) * pose;
    const auto images = prepare_images(view.image->view(), nullptr);
    return expected_points(*map_, *input_.camera, pose, *images, nullptr, most, options_);
  }
  [[nodiscard]] static double share_found(const std::vector<ExpectedPoint>& points) {
    return static_cast<double>(std::count_if(points.begin(), points.end(), [](auto& p) { return p.found; })) /
           static_cast<double>(points.size());
  }

  MapSnapshotPtr map_;
  RefindOptions options_;
};

TEST_F(ExpectedPointsTest, FindsWhatTheMapHas) {
  const auto points = look(scene_, 4);
  EXPECT_GT(points.size(), 200U);
  EXPECT_GT(share_found(points), 0.7);
  for (const ExpectedPoint& p : points) {
    EXPECT_TRUE(input_.camera->in_image(p.pixel.cast<double>()));
    EXPECT_GT(p.depth, 0);
  }
}

TEST_F(ExpectedPointsTest, TellsWhatHasChangedOrIsElsewhere) {
  const double as_it_was = share_found(look(scene_, 4));
  const Scene changed(11, 5, 1.0);
  const double with_another_board = share_found(look(changed, 4));
  EXPECT_LT(with_another_board, 0.9 * as_it_was);
  EXPECT_GT(with_another_board, 0.05) << "what stands behind the board is still there";
  EXPECT_LT(share_found(look(scene_, 4, 0.15)), 0.5 * as_it_was);
}

TEST_F(ExpectedPointsTest, OfManyItTakesAChoiceThatIsSpread) {
  const auto all = look(scene_, 4);
  const auto some = look(scene_, 4, 0, 50);
  EXPECT_EQ(some.size(), 50U);
  EXPECT_NEAR(share_found(some), share_found(all), 0.25);
  EXPECT_GT(some.back().id, all[all.size() / 2].id);
}

/// An operator's own values reach it, as they reach the map maker.
TEST_F(ExpectedPointsTest, ItLooksByTheOptionsThatItIsGiven) {
  const size_t by_default = look(scene_, 4).size();
  options_.visible_cosine = 1;
  EXPECT_LT(look(scene_, 4).size(), by_default / 2) << "from nowhere else than the keyframe";
  options_ = {};
  options_.image_border = 60;
  EXPECT_LT(look(scene_, 4).size(), by_default);
  options_ = {};
  options_.radius = 0;
  EXPECT_LT(share_found(look(scene_, 4)), 0.2);
}

}  // namespace
}  // namespace cairn
