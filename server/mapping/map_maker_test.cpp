// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_maker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "common/geometry/alignment.h"
#include "common/image/pyramid.h"
#include "server/mapping/map_maker_fixture.h"
#include "server/mapping/map_record.h"
#include "server/mapping/map_state.h"
#include "server/mapping/upright.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::HasSubstr;
using testing::kNeverYield;
using testing::kSecondStep;
using testing::make_offer;
using testing::Scene;

/// Distance of each live point from the surface it was made on, over its depth: the source pixel's ray gives
/// the truth.
std::vector<double> point_errors(const Scene& scene, const MapSnapshot& s,
                                 const std::vector<int>& step_of_keyframe) {
  std::vector<Eigen::Vector3d> mapped;
  std::vector<Eigen::Vector3d> truth;
  std::vector<double> depths;
  for (const auto& block : s.point_blocks) {
    for (int i = 0; i < block->count; ++i) {
      const PointSource& source = block->source(i);
      if (!s.find(source.id)) continue;
      const SE3 pose = Scene::pose(step_of_keyframe[source.keyframe.value - 1]);
      const Eigen::Vector3d hit = scene.hit(
          pose, {from_level(source.corner.x, source.level), from_level(source.corner.y, source.level)});
      mapped.push_back(block->position(i));
      truth.push_back(hit);
      depths.push_back((pose * hit).z());
    }
  }
  const auto world_from_map = align_points(mapped, truth, true);
  std::vector<double> errors;
  if (!world_from_map) return errors;
  for (size_t i = 0; i < mapped.size(); ++i)
    errors.push_back((*world_from_map * mapped[i] - truth[i]).norm() / depths[i]);
  std::sort(errors.begin(), errors.end());
  return errors;
}

class MapMakerTest : public testing::MapMakerFixture {
 protected:
  void expect_accurate(double median, double percentile95) {
    const std::vector<double> errors = point_errors(scene_, *maker_->snapshot(), steps_);
    ASSERT_GT(errors.size(), 200U);
    EXPECT_LT(errors[errors.size() / 2], median);
    EXPECT_LT(errors[errors.size() * 95 / 100], percentile95);
  }
};

TEST_F(MapMakerTest, StartsFromTwoViews) {
  start();
  const auto s = maker_->snapshot();
  EXPECT_EQ(s->revision, Revision{1});
  EXPECT_EQ(s->keyframe_count(), 2U);
  EXPECT_GT(s->point_count(), seed_.points.size() * 5 / 4) << "no new points beside the trails'";
  EXPECT_GT(seed_.points.size(), input_.trails.size() / 2);
  for (const auto& [trail, point] : seed_.points) EXPECT_TRUE(s->find(point));
  const double baseline =
      (s->find(KeyframeId{1})->camera_from_map.center() - s->find(KeyframeId{2})->camera_from_map.center())
          .norm();
  EXPECT_NEAR(baseline, 0.1, 1e-6);
  EXPECT_TRUE(seed_.plane_aligned);
  EXPECT_GT(s->find(KeyframeId{1})->camera_from_map.center().z(), 0);
  EXPECT_LT(maker_->reprojection_rms(), 0.6);
  expect_accurate(0.01, 0.05);
}

TEST_F(MapMakerTest, NothingIsMadeOfWhatStandsStill) {
  constexpr int kEdge = 200;
  // What is refined from a corner beside the edge may come to lie a little beyond it.
  const auto left_of_it = [&] {
    size_t measured = 0;
    for (const KeyframeView& view : maker_->keyframe_views()) {
      measured += static_cast<size_t>(std::count_if(view.measurements.begin(), view.measurements.end(),
                                                    [](const auto& m) { return m.pixel.x() < kEdge - 8; }));
    }
    return measured;
  };
  start();
  ASSERT_GT(left_of_it(), 20U);
  mask_left_of(kEdge);
  start();
  for (const int step : {5, 8, 11}) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  EXPECT_EQ(left_of_it(), 0U);
  for (const KeyframeView& view : maker_->keyframe_views()) {
    for (int l = 0; l < kPyramidLevels; ++l) {
      for (const Corner& c : (*view.corners)[static_cast<size_t>(l)].corners)
        ASSERT_GE(from_level(static_cast<float>(c.x), l), kEdge);
    }
  }
}

TEST_F(MapMakerTest, CeresMakesTheSameMap) {
  start();
  MapMakerOptions options;
  options.adjuster = Adjuster::kCeres;
  const auto by_ceres = MapMaker::start(input_, options);
  ASSERT_TRUE(by_ceres) << by_ceres.error().message;
  const auto ours = maker_->snapshot();
  const auto theirs = by_ceres->first->snapshot();
  EXPECT_NEAR(static_cast<double>(ours->point_count()), static_cast<double>(theirs->point_count()),
              0.05 * static_cast<double>(ours->point_count()));
  for (const KeyframeId id : {KeyframeId{1}, KeyframeId{2}}) {
    const SE3 difference = ours->find(id)->camera_from_map * theirs->find(id)->camera_from_map.inverse();
    EXPECT_LT(difference.log().norm(), 0.01);
  }
}

TEST_F(MapMakerTest, RefusesAStandingCamera) {
  input_.second_image = scene_.render(Scene::pose(0), 99);
  for (Trail& t : input_.trails) t.second = t.first;
  const auto started = MapMaker::start(input_, {});
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().code, ErrorCode::kDegenerate);
  EXPECT_FALSE(started.error().message.empty());
}

TEST_F(MapMakerTest, RefusesInputThatIsNoPairOfViews) {
  SeedInput wrong_size = input_;
  wrong_size.second_image = std::make_shared<GrayImage>(64, 48);
  EXPECT_EQ(MapMaker::start(wrong_size, {}).error().code, ErrorCode::kDamaged);
  SeedInput no_camera = input_;
  no_camera.camera = nullptr;
  EXPECT_EQ(MapMaker::start(no_camera, {}).error().code, ErrorCode::kDamaged);
  SeedInput no_trails = input_;
  no_trails.trails.clear();
  EXPECT_EQ(MapMaker::start(no_trails, {}).error().code, ErrorCode::kDegenerate);
  SeedInput wild = input_;
  for (Trail& t : wild.trails) t.second = {std::nanf(""), 1e30F};
  EXPECT_EQ(MapMaker::start(wild, {}).error().code, ErrorCode::kDegenerate);
  SeedInput standing = input_;
  standing.second_from_first = SE3();
  EXPECT_EQ(MapMaker::start(standing, {}).error().code, ErrorCode::kDamaged);
  SeedInput elsewhere = input_;
  elsewhere.second_from_first = input_.second_from_first.inverse();
  EXPECT_EQ(MapMaker::start(elsewhere, {}).error().code, ErrorCode::kDegenerate);
}

/// Whatever keyframes are spaced by: its depths need the parallax. Once it spans a tenth of them, it waits.
TEST_F(MapMakerTest, AYoungMapTakesWhatWidensIt) {
  options_.min_keyframe_distance = 100;
  start();
  EXPECT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  EXPECT_EQ(offer(9).verdict, KeyframeVerdict::kTooClose);
}

TEST_F(MapMakerTest, GrowsAndGetsMoreAccurate) {
  start();
  const size_t points_at_start = maker_->statistics().points;
  for (int step = 5; step <= 14; step += 3) {
    SCOPED_TRACE(step);
    EXPECT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  }
  EXPECT_TRUE(maker_->wants_global_adjustment());
  EXPECT_TRUE(adjust_globally().changed);
  EXPECT_GT(maker_->statistics().points, points_at_start * 3 / 2);
  EXPECT_LT(maker_->reprojection_rms(), 0.5);
  expect_accurate(0.004, 0.015);
  const MapStatistics stats = maker_->statistics();
  EXPECT_LT(static_cast<double>(stats.bytes) / static_cast<double>(stats.keyframes), 1.5e6);
}

TEST_F(MapMakerTest, SaysWhyItRefusesAFrame) {
  start();
  const auto s = maker_->snapshot();
  const KeyframeInput good = make_offer(scene_, *s, 5);
  KeyframeInput stale = good;
  stale.reference = KeyframeId{77};
  EXPECT_EQ(maker_->add_keyframe(stale).verdict, KeyframeVerdict::kStale);
  KeyframeInput few = good;
  few.measurements.resize(10);
  EXPECT_EQ(maker_->add_keyframe(few).verdict, KeyframeVerdict::kTooFewPoints);
  KeyframeInput unknown = good;
  for (PointMeasurement& m : unknown.measurements) m.id.value += 1000000;
  EXPECT_EQ(maker_->add_keyframe(unknown).verdict, KeyframeVerdict::kTooFewPoints);
  KeyframeInput damaged = good;
  damaged.image = std::make_shared<GrayImage>(64, 48);
  EXPECT_EQ(maker_->add_keyframe(damaged).verdict, KeyframeVerdict::kDamaged);
  EXPECT_FALSE(maker_->add_keyframe(damaged).reason.empty());
  EXPECT_EQ(maker_->add_keyframe(make_offer(scene_, *s, kSecondStep)).verdict, KeyframeVerdict::kTooClose);
  EXPECT_EQ(maker_->statistics().keyframes, 2U);
  EXPECT_EQ(maker_->snapshot(), s);
  EXPECT_EQ(maker_->add_keyframe(good).verdict, KeyframeVerdict::kAccepted);
}

TEST_F(MapMakerTest, AnImageIsDecodedOnceAndOnlyWhereTheFrameIsNotRefusedWhateverItShows) {
  start();
  const KeyframeInput good = make_offer(scene_, *maker_->snapshot(), 5);
  KeyframeInput stale = good;
  stale.reference = KeyframeId{77};
  KeyframeInput few = good;
  few.measurements.resize(10);
  int decoded = 0;
  const auto offer_by_its_bytes = [&](KeyframeInput input, GrayImagePtr image) {
    input.image = nullptr;
    decoded = 0;
    return maker_->add_keyframe(input, [&]() -> Result<GrayImagePtr> {
      ++decoded;
      if (!image) return fail(ErrorCode::kDamaged, "JPEG image: cut short");
      return image;
    });
  };
  for (const KeyframeInput& input : {stale, few}) {
    const KeyframeDecision refused = offer_by_its_bytes(input, good.image);
    EXPECT_EQ(decoded, 0);
    const KeyframeDecision decision = maker_->add_keyframe(input);
    EXPECT_EQ(refused.verdict, decision.verdict);
    EXPECT_EQ(refused.reason, decision.reason);
  }
  KeyframeInput chained = few;  // its image shows what it has not measured
  chained.is_chained = true;
  for (const KeyframeInput& input : {good, chained}) {
    const KeyframeDecision damaged = offer_by_its_bytes(input, nullptr);
    EXPECT_EQ(damaged.verdict, KeyframeVerdict::kDamaged);
    EXPECT_EQ(damaged.reason, "JPEG image: cut short");
    EXPECT_EQ(decoded, 1);
    EXPECT_EQ(offer_by_its_bytes(input, std::make_shared<GrayImage>(64, 48)).reason,
              "the image is not of the camera's size");
  }
  KeyframeInput without = good;
  without.image = nullptr;
  EXPECT_EQ(maker_->add_keyframe(without).verdict, KeyframeVerdict::kDamaged);
  EXPECT_EQ(offer_by_its_bytes(chained, good.image).verdict, KeyframeVerdict::kAccepted);
  EXPECT_EQ(decoded, 1);
}

/// A tracker may hold another state of the map than the server, by its fault or ours: then what it calls by a
/// number is not what the map has under it.
TEST_F(MapMakerTest, AFrameOfWhichNothingAgreesWithTheMapIsRefusedWhateverItsPoseSays) {
  start();
  const auto before = maker_->snapshot();
  const KeyframeInput good = make_offer(scene_, *before, 5);
  KeyframeInput other_points = good;  // the pose is true all the same
  for (size_t i = 0; i < good.measurements.size(); ++i)
    other_points.measurements[i].id = good.measurements[(i + 7) % good.measurements.size()].id;
  KeyframeInput other_place = good;  // pose and measurements fit together, and not to the image
  other_place.image = testing::Scene(12).render(testing::Scene::pose(5), 5);
  KeyframeInput other_points_and_pose = other_points;
  other_points_and_pose.camera_from_reference =
      SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.1, 0.2, -0.1)) * good.camera_from_reference;
  for (const KeyframeInput& input : {other_points, other_place, other_points_and_pose}) {
    const KeyframeDecision decision = maker_->add_keyframe(input);
    EXPECT_EQ(decision.verdict, KeyframeVerdict::kTooFewPoints);
    EXPECT_FALSE(decision.reason.empty());
    EXPECT_EQ(maker_->snapshot(), before);
  }
  EXPECT_THAT(maker_->add_keyframe(other_place).reason, HasSubstr("another state of this one"));
  EXPECT_EQ(maker_->add_keyframe(good).verdict, KeyframeVerdict::kAccepted);
}

/// A client that was cut off has measured nothing of what the map has become since.
TEST_F(MapMakerTest, AFrameOfAChainIsPlacedByWhatTheMapExpectsInIt) {
  start();
  const auto before = maker_->snapshot();
  KeyframeInput unmeasured = make_offer(scene_, *before, 5);
  unmeasured.measurements.clear();
  EXPECT_EQ(maker_->add_keyframe(unmeasured).verdict, KeyframeVerdict::kTooFewPoints);
  KeyframeInput chained = unmeasured;
  chained.is_chained = true;
  KeyframeInput wrong = chained;
  wrong.camera_from_reference =
      SE3(so3_exp({0, 0.1, 0}), Eigen::Vector3d(0.1, 0.2, -0.1)) * chained.camera_from_reference;
  EXPECT_EQ(maker_->add_keyframe(wrong).verdict, KeyframeVerdict::kTooFewPoints);
  KeyframeInput damaged = chained;
  damaged.image = std::make_shared<GrayImage>(64, 48);
  EXPECT_EQ(maker_->add_keyframe(damaged).verdict, KeyframeVerdict::kDamaged);
  EXPECT_EQ(maker_->snapshot(), before) << "what is refused harms nothing";
  EXPECT_EQ(maker_->add_keyframe(chained).verdict, KeyframeVerdict::kAccepted);
}

TEST_F(MapMakerTest, APointThatIsMeasuredTwiceCountsOnce) {
  start();
  KeyframeInput input = make_offer(scene_, *maker_->snapshot(), 5);
  ASSERT_GT(input.measurements.size(), 10U);
  input.measurements.resize(10);
  for (int copies = 0; copies < 9; ++copies) {
    for (size_t i = 0; i < 10; ++i) input.measurements.push_back(PointMeasurement(input.measurements[i]));
  }
  const KeyframeDecision decision = maker_->add_keyframe(input);
  EXPECT_EQ(decision.verdict, KeyframeVerdict::kTooFewPoints);
  EXPECT_THAT(decision.reason, HasSubstr("10 good"));
}

TEST_F(MapMakerTest, AFullMapRefusesKeyframesBeforeItsSlotsEnd) {
  start();
  const auto slots = [this] {
    size_t count = 0;
    for (const auto& block : maker_->snapshot()->point_blocks) count += static_cast<size_t>(block->count);
    return count;
  };
  options_.max_points = slots() + static_cast<size_t>(options_.max_points_per_keyframe);
  start();
  ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  const KeyframeDecision decision = offer(8);
  EXPECT_EQ(decision.verdict, KeyframeVerdict::kFull);
  EXPECT_THAT(decision.reason, HasSubstr("map is full: " + std::to_string(slots()) + " of at most"));
  EXPECT_LE(slots(), options_.max_points);
}

TEST_F(MapMakerTest, ReoptimisesThePoseBeforeItJudges) {
  start();
  KeyframeInput input = make_offer(scene_, *maker_->snapshot(), 5);
  const SE3 truth = input.camera_from_reference;
  Vector6d push;
  push << 0.004, -0.003, 0.005, 0.004, -0.003, 0.004;
  input.camera_from_reference = SE3::exp(push) * input.camera_from_reference;
  const KeyframeDecision decision = maker_->add_keyframe(input);
  ASSERT_EQ(decision.verdict, KeyframeVerdict::kAccepted) << decision.reason;
  const auto s = maker_->snapshot();
  const SE3 found =
      s->find(decision.keyframe)->camera_from_map * s->find(input.reference)->camera_from_map.inverse();
  EXPECT_LT((found * truth.inverse()).log().norm(), 0.3 * push.norm());
}

TEST_F(MapMakerTest, YieldsToAWaitingKeyframeAndFinishesLater) {
  start();
  const KeyframeDecision decision = maker_->add_keyframe(make_offer(scene_, *maker_->snapshot(), 5));
  ASSERT_EQ(decision.verdict, KeyframeVerdict::kAccepted) << decision.reason;
  const StepReport first = maker_->step([] { return true; });
  EXPECT_EQ(first.work, MapWork::kNewPoints);
  EXPECT_FALSE(first.finished);
  EXPECT_FALSE(maker_->wants_global_adjustment());
  work();
  EXPECT_EQ(maker_->step(kNeverYield).work, MapWork::kNone);
  EXPECT_TRUE(maker_->wants_global_adjustment());
}

TEST_F(MapMakerTest, NewerKeyframesRideOnAnAdoptedAdjustment) {
  start();
  for (int step = 5; step <= 11; step += 3) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  const GlobalAdjustmentPtr problem = maker_->prepare_global_adjustment();
  solve(problem.get(), {});
  const KeyframeInput input = make_offer(scene_, *maker_->snapshot(), 14);
  const KeyframeDecision newer = maker_->add_keyframe(input);
  ASSERT_EQ(newer.verdict, KeyframeVerdict::kAccepted);
  steps_.push_back(14);
  const auto relative = [&] {
    const auto s = maker_->snapshot();
    return s->find(newer.keyframe)->camera_from_map * s->find(input.reference)->camera_from_map.inverse();
  };
  const SE3 before = relative();
  EXPECT_TRUE(maker_->adopt(*problem).changed);
  EXPECT_LT((relative() * before.inverse()).log().norm(), 1e-3);
  work();
  EXPECT_TRUE(maker_->wants_global_adjustment()) << "the newest keyframe has not been adjusted with the rest";
  adjust_globally();
  expect_accurate(0.005, 0.02);
}

TEST_F(MapMakerTest, KeepsTheLastGoodMapWhenAnAdjustmentFails) {
  start();
  ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  const auto before = maker_->snapshot();
  const GlobalAdjustmentPtr unsolved = maker_->prepare_global_adjustment();
  const StepReport report = maker_->adopt(*unsolved);
  EXPECT_FALSE(report.changed);
  EXPECT_EQ(maker_->snapshot(), before);
}

/// Of all frames and units that a map could have after an adjustment, it has the one in which the keyframes
/// are as far apart as before and look nearest to where they looked.
TEST_F(MapMakerTest, AdjustmentsLeaveTheMapAsAWholeWhereItWas) {
  start();
  for (int step = 5; step <= 14; step += 3) {
    ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    const auto before = maker_->snapshot();
    const GlobalAdjustmentPtr problem = maker_->prepare_global_adjustment();
    solve(problem.get(), {});
    ASSERT_TRUE(maker_->adopt(*problem).changed);
    const auto after = maker_->snapshot();
    std::array<std::vector<Eigen::Vector3d>, 2> centers;
    std::array<std::vector<Eigen::Vector3d>, 2> seen;
    for (uint64_t id = 1; id <= before->keyframe_count(); ++id) {
      const double depth = before->find(KeyframeId{id})->mean_depth;
      for (size_t when = 0; when < 2; ++when) {
        const SE3 map_from_camera =
            (when == 0 ? before : after)->find(KeyframeId{id})->camera_from_map.inverse();
        centers[when].push_back(map_from_camera.translation());
        for (const double x : {-0.5, 0.5}) {
          for (const double y : {-0.4, 0.4})
            seen[when].push_back(map_from_camera * (depth * Eigen::Vector3d(x, y, 1)));
        }
        seen[when].push_back(map_from_camera.translation());
      }
    }
    const auto spread = [](const std::vector<Eigen::Vector3d>& places) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const auto& p : places) mean += p / static_cast<double>(places.size());
      double sum = 0;
      for (const auto& p : places) sum += (p - mean).squaredNorm();
      return std::sqrt(sum);
    };
    EXPECT_NEAR(spread(centers[1]) / spread(centers[0]), 1, 1e-6) << before->keyframe_count();
    const Similarity3 left = *align_points(seen[1], seen[0], false);
    EXPECT_LT(left.rotation().angularDistance(Eigen::Quaterniond::Identity()), 1e-5);
    EXPECT_LT(left.translation().norm(), 1e-5);
  }
}

Box box_around(const Eigen::Vector3d& center, double half) {
  return {center.array() - half, center.array() + half};
}

std::vector<PointId> points_outside(const MapSnapshot& map, const Extent& extent) {
  std::vector<PointId> outside;
  for (const auto& block : map.point_blocks) {
    for (size_t slot = 0; slot < block->positions->positions.size(); ++slot) {
      const bool is_live = (block->live >> slot & 1) != 0;
      if (is_live && !contains(extent, block->positions->positions[slot].cast<double>()))
        outside.push_back(block->patches->points[slot].id);
    }
  }
  return outside;
}

TEST_F(MapMakerTest, AKeyframeKnowsWhichWayWasUp) {
  const Eigen::Vector3d up = Eigen::Vector3d(0.3, -0.9, 0.2).normalized();
  input_.second_up = UpDirection{up, 0.02};
  start();
  KeyframeInput offered = make_offer(scene_, *maker_->snapshot(), 5);
  offered.up = UpDirection{-up, 0.03};
  ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
  const auto views = maker_->keyframe_views();
  ASSERT_EQ(views.size(), 3U);
  EXPECT_FALSE(views[0].up);
  EXPECT_EQ(views[1].up->up, up);
  EXPECT_EQ(views[2].up->up, -up);
  EXPECT_EQ(views[2].up->sigma, 0.03);
}

/// Where there is no plane to lie on.
TEST_F(MapMakerTest, AMapStandsUprightByGravityWithAllThatIsInIt) {
  MapState map;
  MapKeyframe keyframe;
  keyframe.camera = scene_.camera();
  keyframe.camera_from_map = Scene::pose(7);
  keyframe.up = UpDirection{Eigen::Vector3d(0.3, -0.9, 0.2).normalized(), 0.02};
  const KeyframeId knows = map.add_keyframe(keyframe);
  keyframe.up.reset();
  keyframe.camera_from_map = Scene::pose(3);
  const KeyframeId does_not = map.add_keyframe(keyframe);
  const SE3 before = Scene::pose(3) * Scene::pose(7).inverse();
  stand_upright(does_not, &map);
  EXPECT_EQ(map.keyframe(knows).camera_from_map.translation(), Scene::pose(7).translation()) << "not known";
  stand_upright(knows, &map);
  const SE3& pose = map.keyframe(knows).camera_from_map;
  EXPECT_LT((pose.rotation().conjugate() * map.keyframe(knows).up->up - Eigen::Vector3d::UnitZ()).norm(),
            1e-9);
  const SE3 after = map.keyframe(does_not).camera_from_map * pose.inverse();
  EXPECT_TRUE(after.translation().isApprox(before.translation(), 1e-9));
}

TEST_F(MapMakerTest, AFrameFromOutsideOfItsExtentIsRefusedByName) {
  start();
  KeyframeInput offered = make_offer(scene_, *maker_->snapshot(), 5);
  const SE3 pose =
      offered.camera_from_reference * maker_->snapshot()->find(offered.reference)->camera_from_map;
  offered.extent = box_around(pose.center() + Eigen::Vector3d(10, 0, 0), 9.9);
  const KeyframeDecision refused = maker_->add_keyframe(offered);
  EXPECT_EQ(refused.verdict, KeyframeVerdict::kOutside);
  EXPECT_THAT(refused.reason, HasSubstr("is outside of where this client may let the map grow"));
  EXPECT_EQ(maker_->snapshot()->keyframe_count(), 2U);
  offered.extent = box_around(pose.center(), 0.05);
  EXPECT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
}

/// The scene is seen by all, and measured as before; only nothing new is made beyond the box.
TEST_F(MapMakerTest, NoPointIsMadeOutsideOfAnExtentWhoeverElseMakesSome) {
  start();
  const auto before = maker_->snapshot();
  const MapStatistics all = maker_->statistics();
  const double middle = 0.5 * (all.bounds_min.x() + all.bounds_max.x());
  Box left = box_around(Eigen::Vector3d::Zero(), 100);
  left.max.x() = middle;
  KeyframeInput offered = make_offer(scene_, *before, 5);
  const SE3 pose = offered.camera_from_reference * before->find(offered.reference)->camera_from_map;
  left.max.x() = std::max(middle, pose.center().x() + 0.01);
  offered.extent = left;
  const size_t outside_before = points_outside(*before, left).size();
  ASSERT_GT(outside_before, 20U) << "the box must leave something out";
  ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
  steps_.push_back(5);
  const PointId last{before->point_blocks.back()->patches->points.back().id};
  work();
  const auto after = maker_->snapshot();
  EXPECT_GT(after->point_count(), before->point_count());
  for (const PointId id : points_outside(*after, left)) EXPECT_LE(id, last) << "made outside";
  // Who may go everywhere does.
  ASSERT_EQ(offer(8).verdict, KeyframeVerdict::kAccepted);
  const PointId newest{after->point_blocks.back()->patches->points.back().id};
  const auto outside = points_outside(*maker_->snapshot(), left);
  EXPECT_TRUE(std::any_of(outside.begin(), outside.end(), [&](PointId id) { return id > newest; }));
}

/// Where next to every keyframe is redundant, one gives way to those that come, but not to who only adds.
TEST_F(MapMakerTest, WhoOnlyAddsTakesNothingAway) {
  options_.upkeep.redundant_fraction = 0.01;
  options_.upkeep.redundant_observers = 1;
  options_.upkeep.newest_kept = 0;
  for (const bool adds_only : {true, false}) {
    start();
    size_t keyframes = maker_->snapshot()->keyframe_count();
    bool any_gave_way = false;
    for (const int step : {5, 8, 11, 14}) {
      KeyframeInput offered = make_offer(scene_, *maker_->snapshot(), step);
      offered.adds_only = adds_only;
      ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
      steps_.push_back(step);
      work();
      any_gave_way = any_gave_way || maker_->snapshot()->keyframe_count() <= keyframes;
      keyframes = maker_->snapshot()->keyframe_count();
    }
    EXPECT_EQ(any_gave_way, !adds_only);
  }
}

/// Before, a writer's next upkeep took a point away that the frame of somebody who only adds had not shown.
TEST_F(MapMakerTest, WhatAFrameOfWhoOnlyAddsDoesNotShowCostsNoPoint) {
  options_.upkeep.min_attempts = 2;
  options_.upkeep.min_found_fraction = 0.6;
  const auto covered = std::make_shared<GrayImage>(scene_.view(5)->view());
  const int width = covered->width() / 2;
  for (int y = 0; y < covered->height(); ++y) std::fill_n(covered->row(y), width, uint8_t{128});
  for (const bool adds_only : {true, false}) {
    start();
    const MapSnapshotPtr before = maker_->snapshot();
    KeyframeInput offered = make_offer(scene_, *before, 5, covered);
    offered.adds_only = adds_only;
    const SE3 pose = offered.camera_from_reference * before->find(offered.reference)->camera_from_map;
    ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
    work();
    for (const int step : {8, 11}) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    int hidden = 0;
    int gone = 0;
    for (const auto& [trail, point] : seed_.points) {
      const PointSlot at = before->find(point).value();
      const auto pixel = scene_.camera()->project(
          pose * before->point_blocks[static_cast<size_t>(at.block)]->position(at.slot));
      if (!pixel || pixel->x() < 10 || pixel->x() > width - 10) continue;
      ++hidden;
      gone += maker_->snapshot()->find(point) ? 0 : 1;
    }
    ASSERT_GT(hidden, 50);
    if (adds_only) {
      EXPECT_LT(gone, hidden / 10);
    } else {
      EXPECT_GT(gone, hidden / 3) << "the frame must tell against them";
    }
  }
}

/// A writer's keyframe that those of who only adds make redundant stays when the next writer comes.
TEST_F(MapMakerTest, WhoOnlyAddsMakesNobodysKeyframeRedundant) {
  options_.upkeep.redundant_fraction = 0.01;
  options_.upkeep.redundant_observers = 5;  // all others of six
  options_.upkeep.newest_kept = 0;
  for (const bool adds_only : {true, false}) {
    start();
    for (const int step : {5, 8, 11, 14}) {
      KeyframeInput offered = make_offer(scene_, *maker_->snapshot(), step);
      offered.adds_only = adds_only && step > 5 && step < 14;
      ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
      work();
    }
    EXPECT_EQ(maker_->snapshot()->keyframe_count() == 6U, adds_only);
  }
}

TEST_F(MapMakerTest, ASeedIsHeldToItsExtent) {
  start();
  const auto everywhere = maker_->snapshot();
  const MapStatistics all = maker_->statistics();
  input_.extent = box_around(all.bounds_max.cast<double>() + Eigen::Vector3d(50, 0, 0), 10);
  const auto refused = MapMaker::start(input_, options_);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
  EXPECT_THAT(refused.error().message, HasSubstr("is outside of where this client may let the map grow"));
  Box part = box_around(Eigen::Vector3d::Zero(), 100);
  part.max.x() = std::max({0.5 * (all.bounds_min.x() + all.bounds_max.x()),
                           everywhere->find(KeyframeId{1})->camera_from_map.center().x() + 0.01,
                           everywhere->find(KeyframeId{2})->camera_from_map.center().x() + 0.01});
  input_.extent = part;
  start();
  EXPECT_LT(maker_->snapshot()->point_count(), everywhere->point_count());
  EXPECT_TRUE(points_outside(*maker_->snapshot(), part).empty());
  for (const auto& [trail, point] : seed_.points) EXPECT_TRUE(maker_->snapshot()->find(point)) << "is told";
}

TEST_F(MapMakerTest, SameInputSameBytes) {
  std::vector<uint8_t> runs[2];
  for (auto& run : runs) {
    start();
    for (int step = 5; step <= 11; step += 3) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    adjust_globally();
    run = bytes_of(*maker_->snapshot());
  }
  EXPECT_EQ(runs[0], runs[1]);
}

}  // namespace
}  // namespace cairn
