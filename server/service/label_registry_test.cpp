// SPDX-License-Identifier: Apache-2.0
#include "server/service/label_registry.h"

#include <gtest/gtest.h>

#include <random>

namespace cairn {
namespace {

using wire::RequestAction;
using wire::RequestDecision;

constexpr unsigned kSeed = 31;
constexpr Epoch kEpoch{5};
constexpr Timestamp kNow{100};

class LabelRegistryTest : public ::testing::Test {
 protected:
  SE3 pose() {
    Vector6d xi;
    for (int i = 0; i < 6; ++i) xi(i) = std::uniform_real_distribution<double>(-1, 1)(random_);
    return SE3::exp(xi);
  }
  /// Keyframes 1, 2, ... where null: removed.
  static MapSnapshot map_of(const std::vector<std::optional<SE3>>& poses) {
    auto block = std::make_shared<KeyframeBlock>();
    for (size_t i = 0; i < poses.size(); ++i) {
      block->keyframes.push_back({{i + 1}, poses[i].value_or(SE3()), 1});
      if (poses[i]) block->live |= uint64_t{1} << i;
    }
    MapSnapshot map;
    map.epoch = kEpoch;
    map.keyframe_blocks = {block};
    return map;
  }
  static wire::ClientRequest request(RequestAction action, LabelId label, std::string text = {}) {
    wire::ClientRequest made;
    made.action = action;
    made.label = label;
    made.text = std::move(text);
    made.epoch = kEpoch;
    made.reference = {1};
    return made;
  }
  /// Judged and kept.
  LabelId add(const std::string& text, KeyframeId reference, const SE3& reference_from_label,
              const MapSnapshot& map) {
    wire::ClientRequest made = request(RequestAction::kAddLabel, {}, text);
    made.reference = reference;
    made.reference_from_label = reference_from_label;
    const auto judged = registry_.judge(made, "anna", kNow, map);
    EXPECT_EQ(judged.decision, RequestDecision::kDone) << judged.reason;
    EXPECT_FALSE(registry_.find(judged.label)) << "not before it is kept";
    registry_.settle(judged, true, map);
    return judged.label;
  }

  std::mt19937 random_{kSeed};
  LabelRegistry registry_;
};

TEST_F(LabelRegistryTest, ALabelRidesOnItsKeyframe) {
  for (int i = 0; i < 50; ++i) {
    SCOPED_TRACE(::testing::Message() << "seed " << kSeed << ", round " << i);
    const MapSnapshot before = map_of({pose(), pose()});
    const SE3 keyframe_from_label = pose();
    const LabelId id = add("vice", {2}, keyframe_from_label, before);
    const MapSnapshot after = map_of({pose(), pose()});
    const auto moves = registry_.follow(after);
    EXPECT_EQ(moves.moved.back(), id);
    const SE3 seen = after.find(KeyframeId{2})->camera_from_map * registry_.find(id)->map_from_label;
    EXPECT_LT((seen * keyframe_from_label.inverse()).log().norm(), 1e-9);
  }
}

TEST_F(LabelRegistryTest, OnlyNoticeableMovesAreToldAndSmallOnesAddUp) {
  const SE3 keyframe = pose();
  const LabelId id = add("vice", {1}, SE3(Eigen::Quaterniond::Identity(), {0, 0, 2}), map_of({keyframe}));
  const auto moved_by = [&](double x) {
    return map_of({SE3(Eigen::Quaterniond::Identity(), {x, 0, 0}) * keyframe});
  };
  int told = 0;
  for (int step = 1; step <= 20; ++step) {
    const auto moves = registry_.follow(moved_by(1e-4 * step));
    told += static_cast<int>(moves.moved.size());
    EXPECT_TRUE(moves.anchored.empty());
  }
  EXPECT_EQ(told, 2) << "2 mm seen from 2 m, told every 0.8 mm";
  EXPECT_TRUE(registry_.follow(moved_by(2e-3)).moved.empty());
  EXPECT_TRUE(registry_.find(id));
}

TEST_F(LabelRegistryTest, WhenItsKeyframeGoesItStaysAndSticksToTheNearest) {
  const SE3 near(Eigen::Quaterniond::Identity(), {0.1, 0, 0});
  const SE3 far(Eigen::Quaterniond::Identity(), {9, 0, 0});
  const LabelId id =
      add("vice", {1}, SE3(Eigen::Quaterniond::Identity(), {0, 0, 1}), map_of({SE3(), far, near}));
  const SE3 before = registry_.find(id)->map_from_label;
  const auto moves = registry_.follow(map_of({std::nullopt, far, near}));
  ASSERT_EQ(moves.anchored.size(), 1U);
  EXPECT_EQ(moves.anchored[0].anchor, KeyframeId{3});
  EXPECT_TRUE(moves.moved.empty());
  EXPECT_LT((registry_.find(id)->map_from_label * before.inverse()).log().norm(), 1e-12);
  EXPECT_TRUE(registry_.follow(map_of({std::nullopt, far, near})).anchored.empty()) << "once";
  EXPECT_TRUE(registry_.follow(map_of({std::nullopt, std::nullopt, std::nullopt})).anchored.empty());
  EXPECT_TRUE(registry_.find(id)) << "a map without keyframes loses no label";
}

TEST_F(LabelRegistryTest, WhatIsKeptComesBackInTheMapAsItIsNow) {
  const MapSnapshot map = map_of({pose(), pose()});
  wire::ClientRequest made = request(RequestAction::kAddLabel, {}, "vice");
  made.reference_from_label = pose();
  const auto judged = registry_.judge(made, "anna", kNow, map);
  ASSERT_TRUE(judged.changed.has_value());
  LabelRecord lost_anchor = *judged.changed;
  lost_anchor.id = 8;
  lost_anchor.anchor = {77};

  LabelRegistry restored;
  restored.restore({*judged.changed, lost_anchor});
  const MapSnapshot adjusted = map_of({pose(), pose()});
  const auto moves = restored.follow(adjusted);
  ASSERT_EQ(restored.all().size(), 2U);
  const Label label = restored.all()[0];
  EXPECT_EQ(label.text, "vice");
  EXPECT_EQ(label.author, "anna");
  EXPECT_EQ(label.time, kNow);
  const SE3 seen = adjusted.find(KeyframeId{1})->camera_from_map * label.map_from_label;
  EXPECT_LT((seen * made.reference_from_label.inverse()).log().norm(), 1e-9);
  EXPECT_LT((restored.all()[1].map_from_label * lost_anchor.map_from_label.inverse()).log().norm(), 1e-12)
      << "of a keyframe that is not there, the pose in the map serves";
  ASSERT_EQ(moves.anchored.size(), 1U);
  const auto next = restored.judge(made, "anna", kNow, adjusted);
  EXPECT_EQ(next.label, LabelId{9}) << "ids go on after the highest";
}

TEST_F(LabelRegistryTest, AnIdThatWasGivenBeforeTheRestartIsNotGivenAgain) {
  LabelRegistry restored;
  restored.restore({}, LabelId{4});  // removed since
  wire::ClientRequest made = request(RequestAction::kAddLabel, {}, "vice");
  made.reference_from_label = pose();
  EXPECT_EQ(restored.last_given(), LabelId{4});
  EXPECT_EQ(restored.judge(made, "anna", kNow, map_of({pose()})).label, LabelId{5});
}

TEST_F(LabelRegistryTest, ChangesTakeEffectWhenTheyAreKeptAndNotOtherwise) {
  const MapSnapshot map = map_of({pose()});
  const LabelId id = add("vise", {1}, pose(), map);
  auto judged = registry_.judge(request(RequestAction::kRenameLabel, id, "vice"), "bob", Timestamp{200}, map);
  ASSERT_EQ(judged.decision, RequestDecision::kDone);
  EXPECT_TRUE(registry_.is_busy(id));
  EXPECT_EQ(registry_.find(id)->text, "vise");
  registry_.settle(judged, false, map);
  EXPECT_FALSE(registry_.is_busy(id));
  EXPECT_EQ(registry_.find(id)->text, "vise");
  judged = registry_.judge(request(RequestAction::kRenameLabel, id, "vice"), "bob", Timestamp{200}, map);
  registry_.settle(judged, true, map);
  EXPECT_EQ(registry_.find(id)->text, "vice");
  EXPECT_EQ(registry_.find(id)->author, "bob");
  judged = registry_.judge(request(RequestAction::kRemoveLabel, id), "bob", kNow, map);
  EXPECT_FALSE(judged.changed);
  EXPECT_TRUE(registry_.find(id));
  registry_.settle(judged, true, map);
  EXPECT_FALSE(registry_.find(id));
}

TEST_F(LabelRegistryTest, ARefusalSaysWhyAndLeavesNothingBehind) {
  const MapSnapshot map = map_of({pose(), std::nullopt});
  const auto refused = [&](const wire::ClientRequest& made) {
    const auto judged = registry_.judge(made, "anna", kNow, map);
    EXPECT_FALSE(judged.reason.empty());
    EXPECT_FALSE(judged.changed);
    EXPECT_FALSE(registry_.is_busy(made.label));
    return judged.decision;
  };
  EXPECT_EQ(refused(request(RequestAction::kAddLabel, {}, "  ")), RequestDecision::kUnfit);
  EXPECT_EQ(refused(request(RequestAction::kAddLabel, {}, std::string(kMaxLabelBytes + 1, 'x'))),
            RequestDecision::kUnfit);
  for (const char* text : {"two\nlines", "K\xfc", "a\u202eb", "a\u0090b", "de\u200bsk", "\u00a0\u3000"})
    EXPECT_EQ(refused(request(RequestAction::kAddLabel, {}, text)), RequestDecision::kUnfit);
  EXPECT_EQ(refused(request(RequestAction::kRenameLabel, {4}, "x")), RequestDecision::kUnknownLabel);
  EXPECT_EQ(refused(request(RequestAction::kRemoveLabel, {4})), RequestDecision::kUnknownLabel);
  wire::ClientRequest stale = request(RequestAction::kAddLabel, {}, "vice");
  stale.reference = {2};
  EXPECT_EQ(refused(stale), RequestDecision::kStale) << "its keyframe is gone";
  stale.reference = {1};
  stale.epoch = {4};
  EXPECT_EQ(refused(stale), RequestDecision::kStale) << "of another epoch";
}

TEST_F(LabelRegistryTest, AMapHasNoMoreLabelsThanItMay) {
  const MapSnapshot map = map_of({SE3()});
  const wire::ClientRequest made = request(RequestAction::kAddLabel, {}, "x");
  for (size_t i = 0; i < kMaxLabels; ++i) {
    const auto judged = registry_.judge(made, "anna", kNow, map);
    ASSERT_EQ(judged.decision, RequestDecision::kDone) << i;
    if (i % 2 == 0) registry_.settle(judged, true, map);  // the others are on their way
  }
  EXPECT_EQ(registry_.judge(made, "anna", kNow, map).decision, RequestDecision::kFull);
}

}  // namespace
}  // namespace cairn
