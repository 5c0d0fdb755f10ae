// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "client/tracking/plane_scene.h"
#include "client/tracking/point_search.h"
#include "client/tracking/pose_finder.h"
#include "client/tracking/seeded_tracker.h"
#include "common/geometry/two_view.h"
#include "common/image/frame_images.h"

namespace cairn {
namespace {

constexpr int64_t kFrame = 33'333'333;  // [ns]

CameraPtr test_camera() {
  return *make_camera(
      {CameraModel::kPinholeRadtan, 320, 240, {262, 262, 159.5, 119.5, -0.1, 0.02, 0.001, -0.001}});
}

/// A camera one metre above the plane, looking down at (x, y), turned a little.
SE3 looking_down(double x, double y, double height = 1.0, double tilt = 0.1) {
  const Eigen::Matrix3d down = (Eigen::Matrix3d() << 1, 0, 0, 0, -1, 0, 0, 0, -1).finished();
  const Eigen::Quaterniond camera_from_map =
      Eigen::Quaterniond(Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX())) * Eigen::Quaterniond(down);
  return {camera_from_map, -(camera_from_map * Eigen::Vector3d(x, y, height))};
}

double center_distance(const SE3& a, const SE3& b) {
  return (a.center() - b.center()).norm();
}
double angle_between(const SE3& a, const SE3& b) {
  return (a * b.inverse()).log().tail<3>().norm();
}

struct SeedWorld {
  CameraPtr camera = test_camera();
  test::PlaneScene scene{7, camera};
};

TEST(FrameImages, CornersAreThoseOfTheImageThatWasGivenLast) {
  SeedWorld world;
  FrameImages images;
  images.build_pyramid(world.scene.render(looking_down(0, 0))->view());
  const size_t before = images.corners(0).corners.size();
  images.build_pyramid(world.scene.render(looking_down(0.2, 0.1))->view());
  const auto all_expected = detect_corners(images.pyramid);
  for (int level = 0; level < kPyramidLevels; ++level) {
    const CornerList& expected = all_expected[static_cast<size_t>(level)];
    ASSERT_FALSE(expected.corners.empty());
    EXPECT_EQ(images.corners(level).corners.size(), expected.corners.size()) << "level " << level;
  }
  EXPECT_NE(images.corners(0).corners.size(), before) << "another image";
}

TEST(Tracker, SideStepOverAPlaneProposesASeedWhoseTrailsAreRight) {
  SeedWorld world;
  Tracker tracker(world.camera, {});
  std::optional<SeedProposal> seed;
  for (int i = 0; i < 40 && !seed; ++i) {
    const SE3 pose = looking_down(0.006 * i, 0.001 * i);
    seed = tracker.track(world.scene.render(pose), {i * kFrame}, nullptr).seed;
    EXPECT_EQ(tracker.relocalization_answered(std::nullopt), PlaceUse::kNotKnown);
    if (!seed) continue;
    // Each trail must follow its place on the plane.
    const SE3 first = looking_down(0, 0);
    int right = 0;
    for (const Trail& t : seed->trails) {
      const Eigen::Vector3d ray =
          first.rotation().conjugate() * world.camera->unproject(t.first.cast<double>());
      const Eigen::Vector3d place = first.center() - ray * (first.center().z() / ray.z());
      const auto expected = world.camera->project(pose * place);
      if (expected && (*expected - t.second.cast<double>()).norm() < 0.5) ++right;
    }
    EXPECT_GT(right, 0.9 * static_cast<double>(seed->trails.size())) << "of " << seed->trails.size();
  }
  EXPECT_TRUE(seed.has_value());
}

/// A place that may be known is not mapped again: a seed needs a fresh "not known", about the trails' own
/// images.
TEST(Tracker, NoSeedWithoutAFreshWordThatThePlaceIsNotKnown) {
  SeedWorld world;
  const auto proposed = [&](const std::function<void(Tracker&, int)>& answer) {
    Tracker tracker(world.camera, {});
    for (int i = 0; i < 40; ++i) {
      const double x = 0.006 * std::max(0, i - 10);  // stands for ten frames
      const FrameResult& result =
          tracker.track(world.scene.render(looking_down(x, 0.2 * x)), {i * kFrame}, nullptr);
      if (result.seed) return true;
      if (result.reloc_query) answer(tracker, i);
    }
    return false;
  };
  EXPECT_FALSE(proposed([](Tracker&, int) {})) << "nobody answers";
  EXPECT_FALSE(proposed([](Tracker& t, int) { t.relocalization_answered(PoseHypothesis{}); })) << "known";
  EXPECT_FALSE(proposed([](Tracker& t, int) { t.place_left_open(); })) << "other maps may know it";
  EXPECT_TRUE(proposed([](Tracker& t, int) { t.relocalization_answered(std::nullopt); }));
  EXPECT_FALSE(proposed([](Tracker& t, int i) {
    t.relocalization_answered(i < 10 ? std::nullopt : std::optional(PoseHypothesis{}));
  })) << "known after all";
  EXPECT_TRUE(proposed([](Tracker& t, int i) {
    if (i == 0) t.start_over(NewMap::kInAnyCase);
  })) << "wished for";
}

TEST(Tracker, StandingAndTurningCamerasProposeNothing) {
  SeedWorld world;
  Tracker standing(world.camera, {});
  Tracker turning(world.camera, {});
  const auto still = world.scene.render(looking_down(0, 0));
  for (int i = 0; i < 15; ++i) {
    EXPECT_FALSE(standing.track(still, {i * kFrame}, nullptr).seed);
    const SE3 turned =
        SE3(so3_exp({0.004 * i, 0.012 * i, 0.01 * i}), Eigen::Vector3d::Zero()) * looking_down(0, 0);
    static_cast<void>(standing.relocalization_answered(std::nullopt));
    static_cast<void>(turning.relocalization_answered(std::nullopt));
    const FrameResult& result = turning.track(world.scene.render(turned), {i * kFrame}, nullptr);
    EXPECT_FALSE(result.seed) << "frame " << i;
    EXPECT_EQ(result.state, TrackingState::kStarting);
  }
}

/// Starts a tracker on a finished map: a seed answer without trails makes it look from the keyframe.
class OnMap : public ::testing::Test {
 protected:
  OnMap() : map(scene.make_map(looking_down(0, 0))), tracker(camera, options()) {
    tracker.seed_accepted(test::answer_with(*map));
    for (int i = 0; i < 3; ++i) {  // found from the keyframe, and verified
      if (step(looking_down(0, 0)).reloc_query) tracker.relocalization_answered(std::nullopt);
    }
  }
  static TrackerOptions options() {
    TrackerOptions o;
    o.make_maps = false;
    return o;
  }
  const FrameResult& step(const SE3& pose) {
    return tracker.track(scene.render(pose), {kFrame * frame++}, map);
  }
  const FrameResult& blank() {
    auto image = std::make_shared<GrayImage>(camera->width(), camera->height());
    return tracker.track(image, {kFrame * frame++}, map);
  }

  CameraPtr camera = test_camera();
  test::PlaneScene scene{3, camera};
  MapSnapshotPtr map;
  Tracker tracker;
  int64_t frame = 0;
};

TEST_F(OnMap, TracksAMovingCameraToAMillimetre) {
  for (int i = 0; i < 30; ++i) {
    const SE3 truth = looking_down(0.1 * std::sin(0.2 * i), 0.05 * std::sin(0.1 * i),
                                   1.0 + 0.1 * std::sin(0.15 * i), 0.1 + 0.05 * std::sin(0.3 * i));
    const FrameResult& result = step(truth);
    ASSERT_TRUE(result.pose_measured) << "frame " << i << " " << result.note;
    EXPECT_EQ(result.state, TrackingState::kTracking);
    EXPECT_LT(center_distance(result.camera_from_map, truth), 1e-3) << "frame " << i;
    EXPECT_LT(angle_between(result.camera_from_map, truth), 1e-3) << "frame " << i;
    EXPECT_GT(result.quality, 0.5);
  }
}

TEST_F(OnMap, CoveredCameraIsLostAndRecoversInTheSameMap) {
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  for (int i = 0; i < 10; ++i) {
    const FrameResult& result = blank();
    EXPECT_FALSE(result.pose_measured);
    EXPECT_EQ(result.state, TrackingState::kLost);
  }
  bool recovered = false;
  const SE3 truth = looking_down(0.05, 0.01);
  for (int i = 0; i < 10 && !recovered; ++i) recovered = step(truth).pose_measured;
  ASSERT_TRUE(recovered);
  EXPECT_LT(center_distance(step(truth).camera_from_map, truth), 2e-3);
}

/// Its memory is believed while it cannot have gone far. Of a covered lens "not known" says nothing, of an
/// image with much to see it says that the camera is elsewhere: then only who compares with all maps is
/// believed.
TEST_F(OnMap, MemoryIsNotBelievedOnceTheCameraWasSeenElsewhere) {
  const test::PlaneScene elsewhere(99, camera);
  const SE3 truth = looking_down(0.02, 0);
  const auto stranger = elsewhere.render(truth);
  const auto is_found_again = [&] {
    bool found = false;
    for (int i = 0; i < 6; ++i) {
      const FrameResult& result = step(truth);
      found |= result.pose_measured;
      if (result.reloc_query) tracker.relocalization_answered(std::nullopt);
    }
    return found;
  };
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  for (int i = 0; i < 4; ++i) {
    if (blank().reloc_query) tracker.relocalization_answered(std::nullopt);
  }
  EXPECT_TRUE(is_found_again());
  for (int i = 0; i < 4; ++i) {
    if (tracker.track(stranger, {++frame * kFrame}, map).reloc_query)
      tracker.relocalization_answered(std::nullopt);
  }
  EXPECT_FALSE(is_found_again());
  tracker.relocalization_answered(PoseHypothesis{
      map->map, map->epoch, KeyframeId{1}, truth * map->find(KeyframeId{1})->camera_from_map.inverse()});
  EXPECT_TRUE(is_found_again());
  for (int i = 0; i < 4; ++i) {
    if (blank().reloc_query) tracker.relocalization_answered(std::nullopt);
  }
  EXPECT_TRUE(is_found_again()) << "since then it is here again";
}

TEST_F(OnMap, MemoryIsBelievedAloneWhenNobodyAnswersAnyMore) {
  const test::PlaneScene elsewhere(99, camera);
  const SE3 truth = looking_down(0.02, 0);
  const auto stranger = elsewhere.render(truth);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  for (int i = 0; i < 4; ++i) {
    if (tracker.track(stranger, {++frame * kFrame}, map).reloc_query)
      tracker.relocalization_answered(std::nullopt);
  }
  bool found = false;
  for (int i = 0; i < 30 && !found; ++i) found = step(truth).pose_measured;
  EXPECT_TRUE(found);
}

/// Desks look alike to who knows one of them: what memory finds waits for the word of who compares with all
/// maps, and gives way to a place that is confirmed elsewhere.
TEST_F(OnMap, WhatMemoryFindsGivesWayToAPlaceConfirmedInAnotherMap) {
  MapId other;
  other.bytes[0] = 99;
  const SE3 truth = looking_down(0.02, 0);
  for (const bool confirmed : {true, false}) {
    for (int i = 0; i < 3; ++i) {
      if (step(looking_down(0.01 * i, 0)).reloc_query) tracker.relocalization_answered(std::nullopt);
    }
    for (int i = 0; i < 4; ++i) {
      if (blank().reloc_query) tracker.relocalization_answered(std::nullopt);
    }
    bool asked = false;
    bool published = false;
    for (int i = 0; i < 5; ++i) {
      const FrameResult& result = step(truth);
      published |= result.pose_measured;
      if (!result.reloc_query) continue;
      EXPECT_TRUE(result.verifying || asked) << "frame " << i;
      asked = true;
      EXPECT_EQ(
          tracker.relocalization_answered(PoseHypothesis{other, map->epoch, KeyframeId{1}, SE3(), confirmed}),
          confirmed ? PlaceUse::kToVerify : PlaceUse::kNotNeeded);
    }
    EXPECT_TRUE(asked);
    EXPECT_EQ(published, !confirmed);
    const SE3 there = truth * map->find(KeyframeId{1})->camera_from_map.inverse();
    tracker.relocalization_answered(PoseHypothesis{map->map, map->epoch, KeyframeId{1}, there});
    for (int i = 0; i < 3; ++i) step(truth);
  }
}

/// A tracker that knows nothing but what it is told of where it may be.
TEST_F(OnMap, AHypothesisIsBelievedWhenThreeFramesVerifyIt) {
  const SE3 truth = looking_down(0.05, 0.01);
  const SE3 rough = SE3(so3_exp({0.01, -0.01, 0.02}), {0.01, 0, -0.01}) * truth;
  Tracker stranger(camera, options());
  const auto image = scene.render(truth);
  EXPECT_FALSE(stranger.track(image, {0}, map).pose_measured);
  stranger.relocalization_answered(PoseHypothesis{
      map->map, map->epoch, KeyframeId{1}, rough * map->find(KeyframeId{1})->camera_from_map.inverse()});
  for (int i = 1; i <= 4; ++i) {
    const FrameResult& result = stranger.track(image, {i * kFrame}, map);
    EXPECT_EQ(result.pose_measured, i >= 3) << "frame " << i << " " << result.note;
    EXPECT_EQ(result.state, i >= 3 ? TrackingState::kTracking : TrackingState::kLost);
    EXPECT_FALSE(result.keyframe) << "before it is verified";
    if (i >= 3) {
      EXPECT_LT(center_distance(result.camera_from_map, truth), 2e-3);
    }
  }
}

TEST_F(OnMap, ACameraThatIsSuddenlyElsewhereAsksAtOnceAndIsTrackedThereWhenItIsVerified) {
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  const test::PlaneScene elsewhere(99, camera);
  auto other = std::make_shared<MapSnapshot>(*elsewhere.make_map(looking_down(0, 0)));
  other->map.bytes[0] = 99;
  const SE3 truth = looking_down(0.05, 0.01);
  const auto image = elsewhere.render(truth);
  const auto show = [&](const MapSnapshotPtr& held) -> const FrameResult& {
    return tracker.track(image, {++frame * kFrame}, held);
  };
  const FrameResult& carried = show(map);
  EXPECT_FALSE(carried.pose_measured);
  ASSERT_TRUE(carried.reloc_query) << "in the first frame";
  const SE3 there = truth * other->find(KeyframeId{1})->camera_from_map.inverse();
  ASSERT_EQ(tracker.relocalization_answered(PoseHypothesis{other->map, other->epoch, KeyframeId{1}, there}),
            PlaceUse::kToVerify);
  for (int i = 0; i < 3; ++i) {
    const FrameResult& result = show(other);
    EXPECT_EQ(result.verifying, i < 2) << "frame " << i << " " << result.note;
    EXPECT_EQ(result.pose_measured, i == 2);
    EXPECT_EQ(result.map, other->map);
    EXPECT_LT(center_distance(result.camera_from_map, truth), 2e-3);
  }
}

/// What hides the corners and leaves the image as it is: blur.
GrayImagePtr blurred(const GrayImage& image) {
  constexpr int kRadius = 12;
  auto out = std::make_shared<GrayImage>(image.width(), image.height());
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      int sum = 0;
      int count = 0;
      for (int v = std::max(0, y - kRadius); v <= std::min(image.height() - 1, y + kRadius); v += 2) {
        for (int u = std::max(0, x - kRadius); u <= std::min(image.width() - 1, x + kRadius); u += 2) {
          sum += image.row(v)[u];
          ++count;
        }
      }
      out->row(y)[x] = static_cast<uint8_t>(sum / count);
    }
  }
  return out;
}

/// On the last points of what leaves the image the pose may run away.
TEST_F(OnMap, APoorPoseFarFromThePredictedOneIsNotBelieved) {
  constexpr int kSharp = 80;  // [px] on the left
  TrackerOptions few = options();
  few.finder.max_points = 200;
  for (const double leap : {0.0, 0.1}) {
    Tracker follower(camera, few);
    follower.relocalization_answered(PoseHypothesis{map->map, map->epoch, KeyframeId{1}, SE3()});
    for (int i = 0; i < 6; ++i) follower.track(scene.render(looking_down(0, 0)), {i * kFrame}, map);
    const GrayImagePtr sharp = scene.render(looking_down(0.005, leap));
    auto image = std::make_shared<GrayImage>(blurred(*sharp)->view());
    for (int y = 0; y < image->height(); ++y) std::copy_n(sharp->row(y), kSharp, image->row(y));
    const FrameResult& result = follower.track(image, {6 * kFrame}, map);
    EXPECT_EQ(result.state, leap == 0 ? TrackingState::kPoor : TrackingState::kLost) << result.note;
    EXPECT_EQ(result.pose_measured, leap == 0) << result.found << " of " << result.attempted;
    EXPECT_GT(result.quality, few.lost_quality) << "which is enough to be found";
  }
}

TEST_F(OnMap, AFrameThatFailsAsksButAnotherMapMustWait) {
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  const SE3 truth = looking_down(0.03, 0);
  const auto image = scene.render(truth);
  const FrameResult& bad = tracker.track(blurred(*image), {++frame * kFrame}, map);
  EXPECT_FALSE(bad.pose_measured);
  ASSERT_TRUE(bad.reloc_query);
  const SE3 there = truth * map->find(KeyframeId{1})->camera_from_map.inverse();
  MapId other;
  other.bytes[0] = 99;
  EXPECT_EQ(tracker.relocalization_answered(PoseHypothesis{other, map->epoch, KeyframeId{1}, there}),
            PlaceUse::kNotNeeded);
  EXPECT_TRUE(tracker.track(image, {++frame * kFrame}, map).pose_measured)
      << "it holds: no verification needed";
  EXPECT_EQ(tracker.relocalization_answered(PoseHypothesis{map->map, map->epoch, KeyframeId{1}, there}),
            PlaceUse::kNotNeeded)
      << "nothing is wanted by who is not in need";
}

// Farther than any search reaches, but its corners look as they did.
TEST_F(OnMap, ACameraThatRollsByMuchIsRecognizedInTheSameFrame) {
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  const SE3 truth = SE3(so3_exp({0, 0, 1.2}), Eigen::Vector3d::Zero()) * looking_down(0.02, 0);
  const FrameResult& result = step(truth);
  ASSERT_TRUE(result.pose_measured);
  EXPECT_LT((result.camera_from_map * truth.inverse()).log().norm(), 0.01);
}

TEST_F(OnMap, AHypothesisInTheSameMapIsTriedBeforeItIsLost) {
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(step(looking_down(0.01 * i, 0)).pose_measured);
  // Aside by more than any search reaches, and so near that corners look otherwise.
  const SE3 truth = SE3(so3_exp({0, 0, 1.2}), Eigen::Vector3d::Zero()) * looking_down(0.02, 0, 0.3);
  const auto image = scene.render(truth);
  ASSERT_TRUE(tracker.track(image, {++frame * kFrame}, map).reloc_query);
  const SE3 there = truth * map->find(KeyframeId{1})->camera_from_map.inverse();
  ASSERT_EQ(tracker.relocalization_answered(PoseHypothesis{map->map, map->epoch, KeyframeId{1}, there}),
            PlaceUse::kToVerify);
  for (int i = 0; i < 3; ++i)
    EXPECT_EQ(tracker.track(image, {++frame * kFrame}, map).pose_measured, i == 2) << "frame " << i;
}

TEST_F(OnMap, AWrongHypothesisChangesNothing) {
  const SE3 truth = looking_down(0.05, 0.01);
  const SE3& keyframe = map->find(KeyframeId{1})->camera_from_map;
  const SE3 far = looking_down(0.4, -0.3);
  MapId other;
  other.bytes[0] = 99;
  const std::vector<PoseHypothesis> wrong = {
      {map->map, map->epoch, KeyframeId{1}, far * keyframe.inverse()},
      {map->map, map->epoch, KeyframeId{77}, truth * keyframe.inverse()},
      {map->map, Epoch{map->epoch.value + 1}, KeyframeId{1}, truth * keyframe.inverse()},
      {other, map->epoch, KeyframeId{1}, truth * keyframe.inverse()},
  };
  for (const PoseHypothesis& hypothesis : wrong) {
    Tracker stranger(camera, options());
    stranger.relocalization_answered(hypothesis);
    for (int i = 0; i < 6; ++i) {
      EXPECT_FALSE(stranger.track(scene.render(truth), {i * kFrame}, map).pose_measured);
    }
  }
}

TEST_F(OnMap, AVerificationThatBreaksStartsAnew) {
  const SE3 truth = looking_down(0.05, 0.01);
  const PoseHypothesis right{map->map, map->epoch, KeyframeId{1},
                             truth * map->find(KeyframeId{1})->camera_from_map.inverse()};
  Tracker stranger(camera, options());
  const auto image = scene.render(truth);
  const auto nothing = std::make_shared<GrayImage>(camera->width(), camera->height());
  int64_t i = 0;
  for (const int good : {1, 2, 1, 2}) {
    stranger.relocalization_answered(right);
    for (int k = 0; k < good; ++k) EXPECT_FALSE(stranger.track(image, {++i * kFrame}, map).pose_measured);
    EXPECT_FALSE(stranger.track(nothing, {++i * kFrame}, map).pose_measured);
  }
}

TEST_F(OnMap, ALostTrackerAsksAtMostFifteenTimesASecondAndOneQueryAtATime) {
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(step(looking_down(0.01 * i, 0)).reloc_query);
  std::vector<int> asked;
  for (int i = 0; i < 40; ++i) {
    if (blank().reloc_query) asked.push_back(i);
  }
  ASSERT_GE(asked.size(), 2U);
  for (size_t i = 1; i < asked.size(); ++i)
    EXPECT_GE(asked[i] - asked[i - 1], 15) << "half a second of patience";
  for (const bool left_open : {false, true}) {
    asked.clear();
    for (int i = 0; i < 30; ++i) {
      if (!blank().reloc_query) continue;
      asked.push_back(i);
      if (left_open) {
        tracker.place_left_open();
      } else {
        tracker.relocalization_answered(std::nullopt);
      }
    }
    for (size_t i = 1; i < asked.size(); ++i) EXPECT_GE(asked[i] - asked[i - 1], 2);
    EXPECT_GE(asked.size(), 5U);
  }
}

TEST_F(OnMap, KeyframesAreProposedFarFromOthersAndNotInARow) {
  int proposed = 0;
  int64_t last = -1000;
  for (int i = 0; i < 60; ++i) {
    const FrameResult& result = step(looking_down(0.005 * i, 0));
    if (!result.keyframe) continue;
    ++proposed;
    EXPECT_GT(0.005 * i, 0.09);
    EXPECT_GE(frame - last, 5);
    last = frame;
    EXPECT_EQ(result.keyframe->reference, KeyframeId{1});
    EXPECT_GE(static_cast<int>(result.keyframe->measurements.size()), result.found);
    tracker.keyframe_answered(result.keyframe->number, std::nullopt);
  }
  EXPECT_GE(proposed, 1);
}

TEST_F(OnMap, PoseRidesOnAnAdjustmentOfItsKeyframe) {
  const SE3 truth = looking_down(0.02, 0);
  ASSERT_TRUE(step(truth).pose_measured);
  // The whole map moves by a rigid motion, as an adjustment may do, farther than any search reaches: so must
  // the pose, at once.
  const SE3 moved_from_map(so3_exp({0.02, -0.01, 0.3}), {0.4, 0.2, -0.01});
  auto moved = std::make_shared<MapSnapshot>(*map);
  auto keyframes = std::make_shared<KeyframeBlock>(*map->keyframe_blocks[0]);
  keyframes->keyframes[0].camera_from_map =
      keyframes->keyframes[0].camera_from_map * moved_from_map.inverse();
  moved->keyframe_blocks = {keyframes};
  moved->revision = Revision{2};
  for (auto& block : moved->point_blocks) {
    auto positions = std::make_shared<PositionBlock>(*block->positions);
    for (auto& p : positions->positions) p = (moved_from_map * p.cast<double>()).cast<float>();
    block = make_point_block(block->patches, positions, moved->keyframe_blocks);
  }
  map = moved;
  const FrameResult& result = step(truth);
  ASSERT_TRUE(result.pose_measured) << result.note;
  EXPECT_LT(center_distance(result.camera_from_map, truth * moved_from_map.inverse()), 1e-3);
}

TEST_F(OnMap, SameFramesSameBytes) {
  Tracker other(camera, options());
  other.seed_accepted(test::answer_with(*map));
  for (int i = 0; i < 3; ++i) {
    if (other.track(scene.render(looking_down(0, 0)), {i * kFrame}, map).reloc_query)
      other.relocalization_answered(std::nullopt);
  }
  for (int i = 3; i < 8; ++i) {
    const auto image = scene.render(looking_down(0.01 * i, 0.005 * i));
    const SE3 a = tracker.track(image, {i * kFrame}, map).camera_from_map;
    const SE3 b = other.track(image, {i * kFrame}, map).camera_from_map;
    EXPECT_EQ(a.translation(), b.translation());
    EXPECT_EQ(a.rotation().coeffs(), b.rotation().coeffs());
  }
}

/// A map made by others, and nobody to be asked where in it the camera is.
TEST_F(OnMap, AStrangerFindsItsPoseFromTheKeyframesAndVerifiesItOverThreeFrames) {
  for (const double turn : {0.0, 0.15}) {  // nearly as the keyframe looks, and aside of it
    Tracker stranger(camera, options());
    EXPECT_EQ(stranger.track(scene.render(looking_down(0, 0)), {0}, nullptr).state, TrackingState::kStarting);
    const SE3 aside(so3_exp({0, turn, 0}), Eigen::Vector3d::Zero());
    const auto image_at = [&](int i) { return scene.render(aside * looking_down(0.04 + 0.002 * i, 0.01)); };
    int first = 0;
    while (first < 40) {
      const FrameResult& result = stranger.track(image_at(first), {(first + 1) * kFrame}, map);
      EXPECT_EQ(result.map, map->map);
      if (result.pose_measured) break;
      EXPECT_EQ(result.state, TrackingState::kLost);
      EXPECT_FALSE(result.note.empty());
      ++first;
    }
    ASSERT_LT(first, 40);
    EXPECT_GE(first, 15 + 2) << "half a second of patience, and three frames";
    const FrameResult& next = stranger.track(image_at(first + 1), {(first + 2) * kFrame}, map);
    EXPECT_EQ(next.state, TrackingState::kTracking);
    EXPECT_LT(center_distance(next.camera_from_map, aside * looking_down(0.04 + 0.002 * (first + 1), 0.01)),
              2e-3);
  }
}

TEST_F(OnMap, AStrangerElsewhereStaysLost) {
  const test::PlaneScene elsewhere(99, camera);
  Tracker stranger(camera, options());
  for (int i = 0; i < 30; ++i) {
    const FrameResult& result =
        stranger.track(elsewhere.render(looking_down(0.005 * i, 0)), {i * kFrame}, map);
    ASSERT_EQ(result.state, TrackingState::kLost) << "frame " << i;
  }
}

/// The map comes when the trails that began it are long dead and the camera has moved on.
TEST_F(OnMap, AMapThatComesLateIsFoundFromItsKeyframes) {
  Tracker late(camera, options());
  late.seed_accepted(test::answer_with(*map));
  bool found = false;
  const SE3 pose = SE3(so3_exp({-0.14, 0, 0}), Eigen::Vector3d::Zero()) * looking_down(0.05, 0.02);
  for (int i = 0; i < 40 && !found; ++i)
    found = late.track(scene.render(pose), {i * kFrame}, map).pose_measured;
  EXPECT_TRUE(found);
}

TEST(PointSearch, PointsSeenFromElsewhereAreNotExpected) {
  const auto camera = test_camera();
  const test::PlaneScene scene(5, camera);
  const auto whole = scene.make_map(looking_down(0, 0));
  PointSearch search(camera, PointSearchOptions());
  std::vector<VisiblePoint> visible;
  search.use_map(whole);
  search.find_visible(looking_down(0, 0), 100000, &visible);
  const size_t all = visible.size();
  ASSERT_GT(all, 100U);

  auto one_sided = std::make_shared<MapSnapshot>(*whole);
  for (auto& block : one_sided->point_blocks) {
    auto positions = std::make_shared<PositionBlock>(*block->positions);
    for (auto& v : positions->visibility)
      v = {-Eigen::Vector3f::UnitZ(), 0.9F, 0.9F, 1.1F};  // from below the plane
    block = make_point_block(block->patches, positions, whole->keyframe_blocks);
  }
  search.use_map(one_sided);
  search.find_visible(looking_down(0, 0), 100000, &visible);
  EXPECT_TRUE(visible.empty());
}

}  // namespace
}  // namespace cairn
