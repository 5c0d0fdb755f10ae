// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/candidate_points.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/image/pyramid.h"
#include "server/mapping/map_maker_fixture.h"
#include "server/mapping/map_record.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::Each;
using ::testing::Lt;
using testing::make_offer;
using testing::Scene;

constexpr int kStep = 9;  // of the scene: its image has an edge that no keyframe has seen
constexpr int kLevel = 1;
constexpr KeyframeId kNewKeyframe{3};

class CandidatePointsTest : public testing::MapMakerFixture {
 protected:
  enum class Where { kSeenByOthers, kNew };

  void SetUp() override { start(); }

  /// Corners of an offered frame that are away from what was measured in it, with their depths times a
  /// factor.
  [[nodiscard]] std::vector<PointCandidate> candidates(const KeyframeInput& offer, Where where,
                                                       double depth_factor = 1, double sigma = 0.03) const {
    const MapSnapshotPtr map = maker_->snapshot();
    const double scale = testing::world_from_map(*map).scale();
    const SE3 pose = Scene::pose(kStep);
    Pyramid pyramid;
    pyramid.build(offer.image->view());
    CornerList corners;
    detect_fast10(pyramid.level(kLevel).view(), 15, &corners);
    std::vector<PointCandidate> made;
    for (const Candidate& c : find_candidates(pyramid.level(kLevel).view(), corners)) {
      const Eigen::Vector2f pixel(from_level(c.corner.x, kLevel), from_level(c.corner.y, kLevel));
      const Eigen::Vector3d hit = scene_.hit(pose, pixel.cast<double>());
      if (is_seen(hit) != (where == Where::kSeenByOthers) || !is_free(pixel, offer.measurements)) continue;
      const double inverse_depth = scale / ((pose * hit).norm() * depth_factor);
      made.push_back({{made.size() + 1},
                      kLevel,
                      pixel,
                      static_cast<float>(inverse_depth),
                      static_cast<float>(sigma * inverse_depth)});
    }
    return made;
  }
  [[nodiscard]] bool is_seen(const Eigen::Vector3d& hit) const {
    return std::any_of(steps_.begin(), steps_.end(), [&](int step) {
      const auto pixel = scene_.camera()->project(Scene::pose(step) * hit);
      return pixel && scene_.camera()->in_image(*pixel) && scene_.sees(Scene::pose(step), hit);
    });
  }
  static bool is_free(const Eigen::Vector2f& pixel, const std::vector<PointMeasurement>& measurements) {
    return std::none_of(measurements.begin(), measurements.end(),
                        [&](const PointMeasurement& m) { return (m.pixel - pixel).norm() < (12 << kLevel); });
  }

  /// How many points the map has more, before any other work is done.
  size_t points_of(const KeyframeInput& offer) {
    const size_t before = maker_->statistics().points;
    const KeyframeDecision decision = maker_->add_keyframe(offer);
    EXPECT_EQ(decision.verdict, KeyframeVerdict::kAccepted) << decision.reason;
    steps_.push_back(kStep);
    return maker_->statistics().points - before;
  }

  /// Distances from the surface over the depth, of the points cut from a keyframe.
  [[nodiscard]] std::vector<double> errors(KeyframeId keyframe) const {
    const MapSnapshotPtr map = maker_->snapshot();
    const Similarity3 world_from_map = testing::world_from_map(*map);
    const SE3 pose = Scene::pose(kStep);
    std::vector<double> made;
    for (const auto& block : map->point_blocks) {
      for (int i = 0; i < block->count; ++i) {
        const PointSource& source = block->source(i);
        if (source.keyframe != keyframe || !map->find(source.id)) continue;
        const Eigen::Vector3d hit = scene_.hit(
            pose, {from_level(source.corner.x, source.level), from_level(source.corner.y, source.level)});
        const double error = (world_from_map * Eigen::Vector3d(block->position(i)) - hit).norm();
        made.push_back(error / (pose * hit).z());
      }
    }
    return made;
  }
  [[nodiscard]] auto wrong_points() const {
    const std::vector<double> all = errors(kNewKeyframe);
    return std::count_if(all.begin(), all.end(), [](double error) { return error > 0.2; });
  }
};

TEST_F(CandidatePointsTest, AreInTheMapAtOnceWhereItHadNothing) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kNew);
  ASSERT_GT(offer.candidates.size(), 5U);
  EXPECT_GT(points_of(offer), offer.candidates.size() / 10) << "those near another are not taken";
  EXPECT_THAT(errors(kNewKeyframe), Each(Lt(0.05)));
}

TEST_F(CandidatePointsTest, AFrameWithoutBringsNoPointsAtOnce) {
  EXPECT_EQ(points_of(make_offer(scene_, *maker_->snapshot(), kStep)), 0U);
}

TEST_F(CandidatePointsTest, OthersThatShowThemCorrectTheDepth) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kSeenByOthers, 1.15, 0.15);
  ASSERT_GT(offer.candidates.size(), 5U);
  EXPECT_GT(points_of(offer), offer.candidates.size() / 10) << "those near another are not taken";
  EXPECT_THAT(errors(kNewKeyframe), Each(Lt(0.05)));
}

TEST_F(CandidatePointsTest, AWrongDepthMakesNoPoint) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kSeenByOthers, 1.6, 0.03);
  ASSERT_GT(offer.candidates.size(), 5U);
  EXPECT_LE(points_of(offer), offer.candidates.size() / 20);
}

TEST_F(CandidatePointsTest, WhatOneCannotKnowMakesNoPoint) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kNew, 1, 0.3);
  ASSERT_GT(offer.candidates.size(), 5U);
  EXPECT_EQ(points_of(offer), 0U);
}

TEST_F(CandidatePointsTest, WhereTheMapHasAPointNoneIsMade) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  const Similarity3 world_from_map = testing::world_from_map(*maker_->snapshot());
  for (const PointMeasurement& m : offer.measurements) {
    const Eigen::Vector3d hit = scene_.hit(Scene::pose(kStep), m.pixel.cast<double>());
    const auto inverse_depth = static_cast<float>(world_from_map.scale() / (Scene::pose(kStep) * hit).norm());
    if (offer.candidates.size() < kMaxCandidates)
      offer.candidates.push_back({{m.id.value}, m.level, m.pixel, inverse_depth, 0.03F * inverse_depth});
  }
  EXPECT_LE(points_of(offer), offer.candidates.size() / 20) << "those whose measurements were not borne out";
}

/// A tracker may be wrong, and no other keyframe can say so yet.
TEST_F(CandidatePointsTest, WhatTheNextKeyframeDoesNotShowGoes) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kNew, 1.6);
  static_cast<void>(points_of(offer));
  const auto before = wrong_points();
  ASSERT_GT(before, 3);
  work();
  ASSERT_EQ(this->offer(kStep + 3).verdict, KeyframeVerdict::kAccepted);
  EXPECT_LE(wrong_points(), before / 4);
}

TEST_F(CandidatePointsTest, AreKeptWithTheMapAndItGoesOnTheSame) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  offer.candidates = candidates(offer, Where::kNew);
  ASSERT_GT(points_of(offer), 0U);
  const auto copy_of = [&](MapMaker* maker) {
    maker->keep_everything_anew();
    auto restored =
        MapMaker::restore(maker->take_changes(), {input_.map, input_.map_name, Epoch{2}}, options_);
    EXPECT_TRUE(restored && restored->repairs.empty());
    return restored ? std::move(restored->maker) : nullptr;
  };
  const auto copy = copy_of(maker_.get());
  ASSERT_TRUE(copy);
  std::vector<std::vector<uint8_t>> ends;
  for (MapMaker* maker : {maker_.get(), copy.get()}) {
    while (maker->step(testing::kNeverYield).work != MapWork::kNone) {
    }
    ends.push_back(bytes_of(*copy_of(maker)->snapshot()));
  }
  EXPECT_EQ(ends[0], ends[1]);
}

TEST_F(CandidatePointsTest, EqualOffersGiveEqualBytesAndTheWorkGoesOn) {
  const auto run = [&] {
    start();
    KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
    offer.candidates = candidates(offer, Where::kNew);
    static_cast<void>(maker_->add_keyframe(offer));
    work();
    EXPECT_TRUE(adjust_globally().changed);
    return bytes_of(*maker_->snapshot());
  };
  EXPECT_EQ(run(), run());
  EXPECT_LT(maker_->reprojection_rms(), 0.6);
}

TEST_F(CandidatePointsTest, NonsenseMakesNoPointsAndTheyAreBounded) {
  KeyframeInput offer = make_offer(scene_, *maker_->snapshot(), kStep);
  const std::vector<PointCandidate> good = candidates(offer, Where::kNew);
  ASSERT_FALSE(good.empty());
  const auto spoilt = [&](auto&& spoil) {
    PointCandidate bad = good.front();
    spoil(bad);
    offer.candidates.push_back(bad);
  };
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  spoilt([](PointCandidate& c) { c.level = kPyramidLevels; });
  spoilt([](PointCandidate& c) { c.pixel.x() = kNan; });
  spoilt([](PointCandidate& c) { c.pixel.x() = -1e9F; });
  spoilt([](PointCandidate& c) { c.inverse_depth = 0; });
  spoilt([](PointCandidate& c) { c.inverse_depth = std::numeric_limits<float>::infinity(); });
  spoilt([](PointCandidate& c) { c.sigma = kNan; });
  offer.candidates.resize(kMaxCandidates, offer.candidates.front());
  offer.candidates.insert(offer.candidates.end(), good.begin(), good.end());  // one too many each
  EXPECT_EQ(points_of(offer), 0U);
}

}  // namespace
}  // namespace cairn
