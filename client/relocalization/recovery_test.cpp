// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/recovery.h"

#include <gtest/gtest.h>

#include <vector>

#include "client/tracking/plane_scene.h"

namespace cairn {
namespace {

constexpr int64_t kMillisecond = 1'000'000;
constexpr int kFailuresToLose = 3;

Timestamp at(int64_t milliseconds) {
  return {milliseconds * kMillisecond};
}

SE3 looking_down(double x, double y) {
  const Eigen::Matrix3d down = (Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished();
  const Eigen::Quaterniond camera_from_map(down);
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, 1))};
}

/// A plane with one keyframe, in which the camera was tracked once, at its keyframe.
class RecoveryTest : public ::testing::Test {
 protected:
  RecoveryTest() {
    frame.build_pyramid(scene.render(home)->view());
    frame.build_tiny();
    const KeyframePose& keyframe = map->keyframe_blocks.front()->keyframes.front();
    here = {map->map, keyframe.id, SE3()};
    recovery.begin_map(here, true, at(0));
  }
  void lose() {
    for (int i = 0; i < kFailuresToLose; ++i) recovery.fail(false, at(0));
  }
  /// All poses that are named for a frame.
  std::vector<PoseStart> starts(Timestamp time) {
    recovery.begin_frame(*map, 1.0, time);
    std::vector<PoseStart> all;
    while (const auto start = recovery.next_start(frame, *map, home, 1.0, time)) all.push_back(*start);
    return all;
  }
  PlaceUse answer(Timestamp time, const std::optional<PoseHypothesis>& hypothesis) {
    EXPECT_NE(recovery.ask(frame, time, true), nullptr);
    return recovery.answered(hypothesis, map->map, true);
  }
  [[nodiscard]] PoseHypothesis hypothesis_here() const {
    return {map->map, map->epoch, here.reference, SE3(), true};
  }

  CameraPtr camera =
      *make_camera({CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, 0, 0, 0, 0}});
  test::PlaneScene scene{21, camera};
  SE3 home = looking_down(0, 0);
  MapSnapshotPtr map = scene.make_map(home);
  FrameImages frame;
  AnchoredPose here;
  Recovery recovery{camera, {kFailuresToLose, 1}};
};

TEST_F(RecoveryTest, SoManyFramesInARowMustFail) {
  for (int round = 0; round < 2; ++round) {
    for (int i = 1; i < kFailuresToLose; ++i) recovery.fail(false, at(i));
    EXPECT_FALSE(recovery.is_lost());
    EXPECT_TRUE(recovery.confirm(0.8F, here, at(10))) << "tracked: published at once";
  }
  lose();
  EXPECT_TRUE(recovery.is_lost());
}

/// What a state holds ends with it.
TEST_F(RecoveryTest, NothingSurvivesATransition) {
  recovery.fail(true, at(0));
  ASSERT_NE(recovery.as<Tracking>(), nullptr);
  EXPECT_TRUE(recovery.as<Tracking>()->failed_at_cut);
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(1)));
  EXPECT_FALSE(recovery.as<Tracking>()->failed_at_cut);
  EXPECT_EQ(recovery.as<Tracking>()->failed_frames, 0);
  recovery.start_over(true);
  EXPECT_TRUE(recovery.insists());
  recovery.enter_map();
  EXPECT_TRUE(recovery.is_lost());
  recovery.start_over(false);
  EXPECT_FALSE(recovery.insists());
  EXPECT_TRUE(recovery.is_starting());
}

TEST_F(RecoveryTest, APoseThatOthersSayIsPublishedAfterThreeFrames) {
  lose();
  EXPECT_EQ(answer(at(100), hypothesis_here()), PlaceUse::kToVerify);
  recovery.begin_frame(*map, 1.0, at(133));
  const auto start = recovery.next_start(frame, *map, home, 1.0, at(133));
  ASSERT_TRUE(start);
  EXPECT_FALSE(start->is_own_guess);
  EXPECT_EQ(start->reach, PoseStart::Reach::kNear) << "geometry confirms it";
  recovery.begin_verifying(*start, at(133));
  EXPECT_FALSE(recovery.confirm(0.5F, here, at(133)));
  EXPECT_FALSE(recovery.confirm(0.5F, here, at(166)));
  EXPECT_TRUE(recovery.confirm(0.5F, here, at(200)));
  EXPECT_NE(recovery.as<Tracking>(), nullptr);
}

TEST_F(RecoveryTest, AQueryThatWasOpenWhenItFoundItselfSaysNothingOfTheServerLater) {
  lose();
  ASSERT_NE(recovery.ask(frame, at(100), true), nullptr);
  recovery.begin_verifying({home, PoseStart::Reach::kNear, 0.25F, false}, at(110));
  for (const int64_t t : {110, 133, 166}) static_cast<void>(recovery.confirm(0.5F, here, at(t)));
  ASSERT_NE(recovery.as<Tracking>(), nullptr);
  lose();
  ASSERT_NE(recovery.ask(frame, at(60'000), true), nullptr);
  EXPECT_FALSE(recovery.query().nobody_answers());
  EXPECT_NE(recovery.ask(frame, at(60'600), true), nullptr);
  EXPECT_TRUE(recovery.query().nobody_answers()) << "this one was not";
}

TEST_F(RecoveryTest, WhatFailsWhileItIsVerifiedIsLostAtOnce) {
  lose();
  recovery.begin_verifying({home, PoseStart::Reach::kWide, 0.4F, true}, at(100));
  EXPECT_FALSE(recovery.confirm(0.5F, here, at(100)));
  recovery.fail(false, at(133));
  EXPECT_TRUE(recovery.is_lost());
}

/// The server compares with all maps: its word is waited for, and when it knows the camera in another map,
/// the own guess is dropped.
TEST_F(RecoveryTest, AnOwnGuessWaitsForTheWordOfTheServer) {
  lose();
  recovery.begin_verifying({home, PoseStart::Reach::kWide, 0.4F, true}, at(100));
  ASSERT_NE(recovery.ask(frame, at(100), true), nullptr);
  for (const int64_t t : {100, 133, 166}) EXPECT_FALSE(recovery.confirm(0.5F, here, at(t)));
  PoseHypothesis elsewhere = hypothesis_here();
  elsewhere.map.bytes[0] ^= 1;
  EXPECT_EQ(recovery.answered(elsewhere, map->map, true), PlaceUse::kToVerify);
  EXPECT_TRUE(recovery.is_lost());

  recovery.begin_verifying({home, PoseStart::Reach::kWide, 0.4F, true}, at(200));
  for (const int64_t t : {200, 233, 266}) EXPECT_FALSE(recovery.confirm(0.5F, here, at(t)));
  EXPECT_TRUE(recovery.confirm(0.5F, here, at(450))) << "patience has an end";
}

TEST_F(RecoveryTest, AFrameThatFailsIsTriedWhereOthersSayOnly) {
  recovery.fail(false, at(0));
  EXPECT_TRUE(starts(at(10)).empty());
  EXPECT_EQ(answer(at(20), hypothesis_here()), PlaceUse::kToVerify);
  EXPECT_EQ(starts(at(30)).size(), 2U) << "near, then wide";
  EXPECT_TRUE(starts(at(40)).empty()) << "it was tried";
}

TEST_F(RecoveryTest, WhoIsLostLooksWhereItWasUntilItMayBeElsewhere) {
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(0)));
  recovery.remember(frame, *map, {here.reference, SE3(), 1.0}, {});
  lose();
  const std::vector<PoseStart> soon = starts(at(500));
  ASSERT_GE(soon.size(), 2U) << "the memory, the last pose";
  for (const PoseStart& start : soon) {
    EXPECT_TRUE(start.is_own_guess);
    EXPECT_GE(start.quality, RecoveryOptions().verified_quality);
    EXPECT_LT((start.camera_from_map * home.inverse()).log().norm(), 0.02);
  }
  EXPECT_TRUE(starts(at(1500)).empty()) << "carried elsewhere, maybe";
}

/// A camera that goes along x for a second and is then lost, 0.6 found in each frame.
class RecoveryOnTheWay : public RecoveryTest {
 protected:
  RecoveryOnTheWay() {
    for (int i = 0; i <= 30; ++i) {
      const SE3 pose = looking_down(0.02 * i, i % 2 == 0 ? 0.001 : 0);
      EXPECT_TRUE(recovery.confirm(0.6F, {map->map, here.reference, pose * home.inverse()}, at(33 * i)));
    }
    lose();
    recovery.begin_frame(*map, 1.0, at(33 * 36));
  }

  SE3 went_on_to = looking_down(0.02 * 36, 0);
  SE3 a_period_back = looking_down(0.02 * 36 - 0.5, 0);
  PoseStart own{went_on_to, PoseStart::Reach::kWide, RecoveryOptions().verified_quality, true};
  PoseStart of_others{a_period_back, PoseStart::Reach::kNear, 0.25F, false};
};

TEST_F(RecoveryOnTheWay, WhereItWentOnToComesFirstAndWhatIsOutOfReachLast) {
  recovery.remember(frame, *map, {here.reference, SE3(), 1.0}, {});
  std::vector<PoseStart> all;
  while (const auto start = recovery.next_start(frame, *map, home, 1.0, at(33 * 36))) all.push_back(*start);
  ASSERT_GE(all.size(), 3U);
  EXPECT_LT((all.front().camera_from_map.center() - went_on_to.center()).norm(), 0.01);
  EXPECT_FALSE(recovery.is_reachable(all.back().camera_from_map)) << "the memory, home";
}

TEST_F(RecoveryOnTheWay, ALeapSaysNothingOfHowTheCameraMoves) {
  constexpr bool kIsLeap = true;
  const SE3 astray = looking_down(3, 0.4);
  recovery.start_over(false);
  for (int i = 0; i <= 30; ++i) {
    const SE3 pose = looking_down(0.02 * i, i % 2 == 0 ? 0.001 : 0);
    EXPECT_TRUE(recovery.confirm(0.6F, {map->map, here.reference, pose * home.inverse()}, at(33 * i)));
  }
  EXPECT_TRUE(
      recovery.confirm(0.6F, {map->map, here.reference, astray * home.inverse()}, at(33 * 31), kIsLeap));
  recovery.begin_frame(*map, 1.0, at(33 * 36));
  EXPECT_TRUE(recovery.is_reachable(went_on_to));
  EXPECT_FALSE(recovery.is_reachable(astray));
}

/// How the camera turned since it was tracked, the small images then and now say: an image of another frame
/// than the one that the pose is of has no part in it.
TEST_F(RecoveryOnTheWay, TheImageOfAnotherFrameDoesNotSayHowItTurned) {
  for (const bool is_held_between : {false, true}) {
    recovery.start_over(false);
    for (int i = 0; i <= 30; ++i) {
      recovery.begin_frame(*map, 1.0, at(33 * i));
      const SE3 pose = looking_down(0.02 * i, i % 2 == 0 ? 0.001 : 0);
      EXPECT_TRUE(recovery.confirm(0.6F, {map->map, here.reference, pose * home.inverse()}, at(33 * i)));
    }
    int t = 33 * 31;
    for (int i = 0; is_held_between && i < 2; ++i, t += 33) {
      recovery.begin_frame(*map, 1.0, at(t));
      recovery.turn_away();
    }
    recovery.begin_frame(*map, 1.0, at(t));
    recovery.lose_sight(frame);
    for (int i = 0; i < kFailuresToLose; ++i) recovery.fail(false, at(t));
    EXPECT_EQ(starts(at(t)).size(), is_held_between ? 2U : 3U) << "gone on, turned, the last pose";
  }
}

TEST_F(RecoveryOnTheWay, WhereItCanHaveGotToLessIsNeededAndNoAnswer) {
  const auto near = recovery.believe(own, {went_on_to, 60, 0.3F}, at(33 * 36));
  ASSERT_TRUE(near);
  EXPECT_LE(near->quality, 0.3F);
  EXPECT_FALSE(near->is_own_guess);
  EXPECT_FALSE(recovery.believe(own, {went_on_to, RecoveryOptions().fewest_points - 1, 0.3F}, at(33 * 36)));
  EXPECT_TRUE(recovery.confirm(0.6F, here, at(33 * 37)));
  for (int i = 0; i < kFailuresToLose; ++i) recovery.fail(true, at(33 * 37));
  recovery.begin_frame(*map, 1.0, at(33 * 38));
  const auto after_cut = recovery.believe(own, {recovery.within_reach(home), 60, 0.3F}, at(33 * 38));
  ASSERT_TRUE(after_cut);
  EXPECT_TRUE(after_cut->is_own_guess) << "the image changed as no hand can move";
}

TEST_F(RecoveryOnTheWay, AfterASecondAGuessOfItsOwnNeedsAnAnswer) {
  recovery.begin_frame(*map, 1.0, at(33 * 30 + 1100));
  const auto late = recovery.believe(own, {looking_down(0.6 + 0.66, 0), 60, 0.3F}, at(33 * 30 + 1100));
  ASSERT_TRUE(late);
  EXPECT_TRUE(late->is_own_guess) << "carried to a place that looks the same, maybe";
}

/// What repeats shows as much at each of its periods, and a map may show more of another one than of that
/// where the camera is.
TEST_F(RecoveryOnTheWay, WhatShowsWithinReachWinsOverMoreOutOfReach) {
  for (const int within : {60, 20}) {
    recovery.begin_frame(*map, 1.0, at(33 * 36));
    while (recovery.next_start(frame, *map, home, 1.0, at(33 * 36))) {
    }
    ASSERT_FALSE(recovery.believe(of_others, {a_period_back, 600, 0.8F}, at(33 * 36)));
    const auto compared = recovery.next_start(frame, *map, home, 1.0, at(33 * 36));
    ASSERT_TRUE(compared);
    EXPECT_LT((compared->camera_from_map * went_on_to.inverse()).log().norm(), 0.01);
    static_cast<void>(recovery.believe(*compared, {went_on_to, within, 0.2F}, at(33 * 36)));
    const auto again = recovery.next_start(frame, *map, home, 1.0, at(33 * 36));
    ASSERT_TRUE(again);
    EXPECT_LT((again->camera_from_map * a_period_back.inverse()).log().norm(), 0.01);
    const auto believed = recovery.believe(*again, {a_period_back, 600, 0.8F}, at(33 * 36));
    EXPECT_EQ(believed.has_value(), within < RecoveryOptions().fewest_points);
    EXPECT_GE(believed.value_or(of_others).quality, of_others.quality);
    EXPECT_FALSE(recovery.next_start(frame, *map, home, 1.0, at(33 * 36)));
  }
}

TEST_F(RecoveryTest, AnAnswerThatNoPlaceIsKnownSaysThatItIsElsewhere) {
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(0)));
  lose();
  ASSERT_FALSE(starts(at(100)).empty());
  EXPECT_EQ(answer(at(100), std::nullopt), PlaceUse::kNotKnown);
  EXPECT_TRUE(starts(at(133)).empty());
}

TEST_F(RecoveryTest, WhereNobodyAnswersTheKeyframesAreLookedThrough) {
  lose();
  ASSERT_NE(recovery.ask(frame, at(2000), true), nullptr);
  ASSERT_NE(recovery.ask(frame, at(2600), true), nullptr) << "given up";
  int quick = 0;
  for (const PoseStart& start : starts(at(2600))) quick += start.reach == PoseStart::Reach::kQuick ? 1 : 0;
  EXPECT_EQ(quick, static_cast<int>(KeyframeRoundsOptions().per_frame));
}

TEST_F(RecoveryTest, AnotherMapIsEnteredFromALostOneOrACutOnly) {
  PoseHypothesis elsewhere = hypothesis_here();
  elsewhere.map.bytes[0] ^= 1;
  recovery.fail(false, at(0));
  EXPECT_EQ(answer(at(10), elsewhere), PlaceUse::kNotNeeded);
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(20)));
  recovery.fail(true, at(200));
  EXPECT_EQ(answer(at(210), elsewhere), PlaceUse::kToVerify) << "the image changed as no hand can move";
}

/// Who knows only how it is turned may have been carried elsewhere: it asks, any map is entered, and what is
/// in sight again is published at once.
TEST_F(RecoveryTest, WhoHasTurnedAwayAsksAndIsBackAtOnce) {
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(0)));
  recovery.turn_away();
  ASSERT_NE(recovery.as<Turned>(), nullptr);
  PoseHypothesis elsewhere = hypothesis_here();
  elsewhere.map.bytes[0] ^= 1;
  EXPECT_EQ(answer(at(33), elsewhere), PlaceUse::kToVerify);
  EXPECT_EQ(answer(at(133), hypothesis_here()), PlaceUse::kToVerify);
  EXPECT_EQ(starts(at(166)).size(), 2U) << "what others say, and no guess of its own";
  EXPECT_TRUE(recovery.confirm(0.8F, here, at(200)));
  recovery.turn_away();
  recovery.fail(false, at(233));
  EXPECT_TRUE(recovery.is_lost());
}

TEST_F(RecoveryTest, WhileStartingItAsksUnlessItInsistsOrIsDecidedAbout) {
  recovery.start_over(true);
  EXPECT_EQ(recovery.ask(frame, at(0), true), nullptr);
  recovery.start_over(false);
  EXPECT_EQ(recovery.ask(frame, at(100), false), nullptr);
  EXPECT_NE(recovery.ask(frame, at(200), true), nullptr);
  EXPECT_EQ(recovery.answered(hypothesis_here(), std::nullopt, true), PlaceUse::kToVerify);
}

}  // namespace
}  // namespace cairn
