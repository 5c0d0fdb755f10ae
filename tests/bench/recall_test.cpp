// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/recall.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

SE3 view(double x, double turn) {
  return {so3_exp({0, turn, 0}), Eigen::Vector3d(x, 0, 0)};
}

TEST(Overlap, NeedsOneViewThatIsNearAndLooksTheSameWay) {
  const std::vector<SE3> mapped = {view(0, 0), view(1, 1.0)};
  EXPECT_TRUE(overlaps_a_view(view(0.2, 0.3), mapped, 0.25));
  EXPECT_TRUE(overlaps_a_view(view(1.2, 0.8), mapped, 0.25));
  EXPECT_FALSE(overlaps_a_view(view(0.3, 0), mapped, 0.25)) << "too far";
  EXPECT_FALSE(overlaps_a_view(view(0, 0.4), mapped, 0.25)) << "23 degrees";
  EXPECT_FALSE(overlaps_a_view(view(1, 0), mapped, 0.25)) << "near one, looking as the other";
  EXPECT_FALSE(overlaps_a_view(view(0, 0), {}, 0.25));
  // A roll of the camera leaves the view where it is.
  EXPECT_TRUE(overlaps_a_view({so3_exp({0, 0, 2}), Eigen::Vector3d::Zero()}, mapped, 0.25));
}

TEST(Recall, CountsWhatIsInViewAndEveryWrongAnswer) {
  Recall recall;
  recall.add({.in_view = true, .answered = true, .right_map = true, .off = Offset{0.05, 1}, .depth = 1});
  recall.add({.in_view = true, .answered = true, .right_map = true, .off = Offset{0.15, 1}, .depth = 1});
  recall.add({.in_view = true, .answered = true, .right_map = true, .off = Offset{0.15, 1}, .depth = 2});
  recall.add({.in_view = true, .answered = true, .right_map = true, .off = Offset{0, 6}, .depth = 2});
  recall.add({.in_view = true, .answered = true, .right_map = false});
  recall.add({.in_view = true, .answered = false});
  recall.add({.in_view = false, .answered = false});
  recall.add({.in_view = false, .answered = true, .right_map = true, .off = Offset{0, 0}, .depth = 1});
  recall.add({.in_view = false, .answered = true, .right_map = false});
  EXPECT_EQ(recall.in_view, 6U);
  EXPECT_EQ(recall.right, 2U);
  EXPECT_EQ(recall.wrong_pose, 2U);
  EXPECT_EQ(recall.elsewhere, 3U);
  EXPECT_EQ(recall.answered_else, 2U);
  EXPECT_EQ(recall.wrong_map, 2U);
  EXPECT_EQ(recall.off.size(), 5U);
  EXPECT_DOUBLE_EQ(recall.share(), 2.0 / 6);
}

TEST(Recall, WithoutTruthTheMapAloneCounts) {
  Recall recall;
  recall.add({.in_view = true, .answered = true, .right_map = true});
  EXPECT_EQ(recall.right, 1U);
  EXPECT_TRUE(recall.off.empty());
}

TEST(Recall, SumsAreAsIfAllHadBeenAskedAtOnce) {
  const Judged right{.in_view = true, .answered = true, .right_map = true, .off = Offset{0, 0}, .depth = 1};
  const Judged wrong{.in_view = false, .answered = true, .right_map = false};
  Recall all;
  Recall some;
  Recall others;
  all.add(right);
  all.add(wrong);
  some.add(right);
  others.add(wrong);
  some.add(others);
  EXPECT_EQ(some.in_view, all.in_view);
  EXPECT_EQ(some.right, all.right);
  EXPECT_EQ(some.elsewhere, all.elsewhere);
  EXPECT_EQ(some.wrong_map, all.wrong_map);
  EXPECT_EQ(some.off, all.off);
  EXPECT_EQ(Recall().share(), 0);
}

}  // namespace
}  // namespace cairn
