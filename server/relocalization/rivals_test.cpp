// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/rivals.h"

#include <gtest/gtest.h>
#include <vector>

namespace cairn {
namespace {

constexpr int kInconsistent = 2;  // cells: one more than a place may have that is believed by its image

/// A keyframe of a map from which a pose was found, the camera so far to the right.
PlaceHypothesis hypothesis(uint8_t map, bool is_confirmed, double right = 0) {
  PlaceHypothesis t;
  t.candidate.map.bytes[0] = map;
  t.mean_depth = 1;
  t.said.confirmed = is_confirmed;
  t.said.inconsistent_cells = is_confirmed ? 0 : kInconsistent;
  t.said.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {-right, 0, 0});
  t.said.inliers = 100;
  t.said.agreeing = 20;
  t.said.agreeing_cells = 5;
  for (size_t corner = 0; corner < 100; ++corner) t.said.found.push_back(corner);
  if (!is_confirmed) return t;
  for (const size_t corner : t.said.found) t.said.explained.push_back({corner, {0, 0, 1}, {right, 0, 1}});
  return t;
}

bool is_believed(const std::vector<PlaceHypothesis>& all) {
  return !find_why_refused({}, all.front(), all);
}

TEST(Rivals, OfThePlaceItselfThreeKeyframesThatShowItOtherwiseOutvoteOne) {
  std::vector<PlaceHypothesis> all = {hypothesis(1, true), hypothesis(1, false), hypothesis(1, false)};
  EXPECT_TRUE(is_believed(all));
  all.push_back(hypothesis(1, false));
  EXPECT_FALSE(is_believed(all));
  EXPECT_EQ(find_why_refused({}, all.front(), all),
            "3 keyframes show this place otherwise in part, 1 as it is");
  all.push_back(hypothesis(1, true));
  EXPECT_TRUE(is_believed(all)) << "two speak for it";
}

TEST(Rivals, NoVoteHasWhoSaysNothingAboutThePose) {
  const std::vector<PlaceHypothesis> place = {hypothesis(1, true), hypothesis(1, false),
                                              hypothesis(1, false)};
  const auto is_believed_beside = [&](const PlaceHypothesis& other) {
    std::vector<PlaceHypothesis> all = place;
    all.push_back(other);
    return is_believed(all);
  };
  EXPECT_FALSE(is_believed_beside(hypothesis(1, false)));
  EXPECT_TRUE(is_believed_beside(hypothesis(2, false))) << "another map";
  EXPECT_TRUE(is_believed_beside(hypothesis(1, false, 2 * 0.15))) << "another pose";
  PlaceHypothesis other = hypothesis(1, false);
  other.said.inliers = 0;
  EXPECT_TRUE(is_believed_beside(other)) << "its pose was not refined";
  other = hypothesis(1, false);
  other.said.inconsistent_cells = kInconsistent - 1;
  EXPECT_TRUE(is_believed_beside(other)) << "refused for something else";
}

TEST(Rivals, APlaceThatHasChangedMayBeShownOtherwise) {
  std::vector<PlaceHypothesis> all = {hypothesis(1, true), hypothesis(1, false), hypothesis(1, false),
                                      hypothesis(1, false)};
  all.front().said.changed = true;
  EXPECT_TRUE(is_believed(all));
}

TEST(Rivals, WhatAnotherMapExplainsAsWellIsNotBelieved) {
  std::vector<PlaceHypothesis> all = {hypothesis(1, true), hypothesis(2, false)};
  EXPECT_TRUE(is_believed(all));
  all[1].said.explained = all[0].said.explained;
  EXPECT_FALSE(is_believed(all));
  all[1].said.explained.resize(70);
  EXPECT_TRUE(is_believed(all)) << "it explains more, and three of ten are its own";
  all[1].said.explained.resize(0);
  for (size_t corner = 0; corner < 78; ++corner)
    all[1].said.explained.push_back({corner, {0, 0, 1}, {0, 0, 1}});
  EXPECT_FALSE(is_believed(all)) << "too few are its own";
}

TEST(Rivals, OfTwoPosesInAMapTheOneWithCornersInMorePartsStands) {
  std::vector<PlaceHypothesis> all = {hypothesis(1, true), hypothesis(1, true, 1)};
  all[1].said.explained.clear();  // so that it is refused for nothing but this
  all[1].said.agreeing_cells = 4;
  EXPECT_TRUE(is_believed(all));
  all[1].said.agreeing_cells = 6;
  EXPECT_FALSE(is_believed(all));
}

}  // namespace
}  // namespace cairn
