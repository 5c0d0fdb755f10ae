// SPDX-License-Identifier: Apache-2.0
#include "tests/world/judge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

namespace cairn {
namespace {

constexpr int kPhaseFrames = 60;

MapId map_id(uint8_t number) {
  MapId id;
  id.bytes.fill(number);
  return id;
}

Timestamp frame_time(int frame) {
  return Timestamp::from_seconds(frame / 30.0);
}

/// The camera circles before a place; what the tracker says of a frame is up to the test.
SE3 place_from_camera(int frame) {
  const double angle = 0.1 * frame;
  return {
      so3_exp({0.2 * std::sin(angle), 0.1, 0.05 * angle}),
      Eigen::Vector3d(0.3 * std::cos(angle), -0.7 + 0.1 * std::sin(2 * angle), 0.4 + 0.2 * std::sin(angle))};
}

/// A map's own frame and scale: poses in it of a camera whose pose about the home is known.
struct MapFrame {
  MapId id;
  Similarity3 map_from_home;
  [[nodiscard]] StampedPose row(Timestamp time, const SE3& home_from_camera) const {
    return {time, map_from_home.transform_camera(home_from_camera.inverse()).inverse()};
  }
};
const MapFrame kFirst = {map_id(1), Similarity3(0.4, so3_exp({0.3, -1, 0.2}), {1, 2, 3})};
const MapFrame kSecond = {map_id(2), Similarity3(2.5, so3_exp({-0.5, 0.1, 2}), {-4, 0, 1})};

/// Phases of kPhaseFrames frames each, before the places that they name, 3 m apart.
class WalkBuilder {
 public:
  explicit WalkBuilder(std::vector<std::string> places) { walk_.annotation.places = std::move(places); }

  using Claim = std::function<void(Trajectory*, Timestamp, const SE3& place_from_camera)>;
  WalkBuilder& phase(PhaseKind kind, int place, const Claim& claim) {
    const SE3 map_from_place =
        at_[place] * SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(3.0 * place, 0, 0));
    walk_.annotation.phases.push_back({kind, place, frame_time(next_), frame_time(next_ + kPhaseFrames)});
    for (int i = 0; i < kPhaseFrames; ++i, ++next_) {
      const Timestamp time = frame_time(next_);
      walk_.annotation.frames.push_back({time, {{place, 0.8, map_from_place}}});
      walk_.truth.push_back({time, map_from_place * place_from_camera(next_)});
      frame_in_phase_ = i;
      claim(&walk_.estimate, time, place_from_camera(next_));
    }
    return *this;
  }
  WalkBuilder& move(int place, const SE3& by) {
    at_[place] = by;
    return *this;
  }
  [[nodiscard]] const WalkRecord& get() const { return walk_; }

  /// In the map from frame `from` of the phase on, before frame `to`.
  Claim in(const MapFrame& map, int from = 0, const SE3& off = {}, int to = kPhaseFrames) {
    return [this, map, from, off, to](Trajectory* estimate, Timestamp time, const SE3& pose) {
      if (frame_in_phase_ < from || frame_in_phase_ >= to) return;
      if (estimate->segments.empty() || estimate->segments.back().map != map.id) {
        estimate->segments.push_back({map.id, "m", {}});
      }
      estimate->segments.back().poses.push_back(map.row(time, off * pose));
    };
  }
  static void lost(Trajectory* /*estimate*/, Timestamp /*time*/, const SE3& /*pose*/) {}

 private:
  WalkRecord walk_;
  std::map<int, SE3> at_;
  int next_ = 0;
  int frame_in_phase_ = 0;
};

SE3 shifted(double metres) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(metres, 0, 0)};
}

TEST(Judge, MapsOfAnyFrameAndScaleAreRightWhereTheyAgree) {
  WalkBuilder making({"a", "b"});
  making.phase(PhaseKind::kMap, 0, making.in(kFirst, 10)).phase(PhaseKind::kMap, 1, making.in(kSecond, 20));
  WalkBuilder coming({"b", "a"});  // names decide, not order
  coming.phase(PhaseKind::kVisit, 0, coming.in(kSecond, 7)).phase(PhaseKind::kVisit, 1, coming.in(kFirst, 0));
  const Verdict verdict = judge({making.get(), coming.get()});
  ASSERT_EQ(verdict.places.size(), 2u);
  EXPECT_EQ(verdict.places_to_map(), 2);
  EXPECT_EQ(verdict.places_mapped(), 2);
  EXPECT_EQ(verdict.places_found(), 2);
  EXPECT_TRUE(verdict.wrong_locks.empty());
  EXPECT_TRUE(verdict.passes());
  ASSERT_EQ(verdict.places[1].visits.size(), 1u);
  EXPECT_EQ(verdict.places[1].visits[0].frames_to_lock, 7);
  EXPECT_EQ(verdict.places[1].visits[0].right, kPhaseFrames - 7);
  EXPECT_EQ(verdict.places[0].visits[0].frames_to_lock, 0);
}

TEST(Judge, LockInAnotherPlacesMapIsWrong) {
  WalkBuilder walk({"a", "b", "c"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kMap, 1, walk.in(kSecond))
      .phase(PhaseKind::kVisit, 0, walk.in(kSecond, 15))  // b's map, as if it were b
      .phase(PhaseKind::kVisit, 2, walk.in(kFirst, 30));  // never mapped, as if it were a
  const Verdict verdict = judge({walk.get()});
  EXPECT_EQ(verdict.places_to_map(), 2);
  EXPECT_EQ(verdict.places_found(), 0);  // b was not visited
  ASSERT_EQ(verdict.wrong_locks.size(), 2u);
  EXPECT_EQ(verdict.wrong_locks[0].map, kSecond.id);
  EXPECT_EQ(verdict.wrong_locks[0].frames, kPhaseFrames - 15);
  EXPECT_NEAR(verdict.wrong_locks[0].metres, 3, 1e-6);
  EXPECT_FALSE(verdict.wrong_locks[0].at_unmapped);
  EXPECT_TRUE(verdict.wrong_locks[1].at_unmapped);
  EXPECT_EQ(verdict.locks_at_unmapped(), 1);
  EXPECT_EQ(verdict.places[0].visits[0].wrong, kPhaseFrames - 15);
  EXPECT_FALSE(verdict.places[0].visits[0].frames_to_lock);
  EXPECT_FALSE(verdict.passes());
}

TEST(Judge, NeighbourSeenRightlyIsNeitherFoundNorWrong) {
  WalkBuilder walk({"a", "b"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kVisit, 1, walk.in(kFirst, 0, shifted(3)));  // a's map reaches to b
  const Verdict verdict = judge({walk.get()});
  EXPECT_TRUE(verdict.wrong_locks.empty());
  EXPECT_EQ(verdict.places[1].visits[0].elsewhere, kPhaseFrames);
  EXPECT_FALSE(verdict.places[1].visits[0].frames_to_lock);
}

TEST(Judge, HomeOutOfViewIsWhereItWasOrWillBeSeen) {
  WalkBuilder making({"a", "b"});
  making.phase(PhaseKind::kMap, 1, making.in(kFirst));
  WalkBuilder coming({"a", "b"});
  coming.phase(PhaseKind::kVisit, 0, coming.in(kFirst, 0, shifted(-3)));  // b's map reaches to a
  WalkBuilder moved({"a", "b"});
  moved.move(1, shifted(2))
      .phase(PhaseKind::kVisit, 0, moved.in(kFirst, 0, shifted(-5)))
      .phase(PhaseKind::kVisit, 1, moved.in(kFirst));
  const Verdict verdict = judge({making.get(), coming.get(), moved.get()});
  EXPECT_TRUE(verdict.wrong_locks.empty());
  EXPECT_EQ(verdict.places[0].visits[0].elsewhere, kPhaseFrames);
}

TEST(Judge, MapGoesWithItsHome) {
  const SE3 moved(so3_exp({0, 0, 0.6}), Eigen::Vector3d(-2, 0.5, 0));
  WalkBuilder walk({"robot"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst)).move(0, moved).phase(PhaseKind::kVisit, 0, walk.in(kFirst));
  EXPECT_TRUE(judge({walk.get()}).passes());
}

TEST(Judge, BoundIsAboutTheTruth) {
  for (const double factor : {0.9, 1.1}) {
    WalkBuilder walk({"a"});
    walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
        .phase(PhaseKind::kVisit, 0, walk.in(kFirst, 0, shifted(factor * kRightMetres)));
    EXPECT_EQ(judge({walk.get()}).passes(), factor < 1);
  }
}

TEST(Judge, HeldForMomentsIsNotTakenForAnotherPlace) {
  for (const int frames : {1, kMostHeldFrames, kMostHeldFrames + 1, kPhaseFrames}) {
    WalkBuilder walk({"a"});
    walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
        .phase(PhaseKind::kWalk, 0, walk.in(kFirst, 0, shifted(1), frames))
        .phase(PhaseKind::kVisit, 0, walk.in(kFirst));
    const Verdict verdict = judge({walk.get()});
    const bool excused = frames <= kMostHeldFrames;
    ASSERT_EQ(verdict.wrong_locks.size(), 1U);
    EXPECT_EQ(verdict.wrong_locks[0].frames, frames);
    EXPECT_TRUE(verdict.wrong_locks[0].held);
    EXPECT_EQ(verdict.wrong_locks[0].excused(), excused);
    EXPECT_EQ(verdict.passes(), excused);
    EXPECT_EQ(verdict.locks_excused(), excused ? 1 : 0);
    EXPECT_EQ(nlohmann::json::parse(verdict_json(verdict))["wrong_locks"][0]["excused"], excused);
    const std::string text = verdict_text(verdict);
    EXPECT_NE(text.find(excused ? "(held too long)" : "(glided)"), std::string::npos) << text;
    EXPECT_NE(text.find(excused ? "wrong locks 0," : "wrong locks 1,"), std::string::npos) << text;
  }
}

TEST(Judge, AfterBeingLostEvenAMomentIsAWrongLock) {
  WalkBuilder walk({"a"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kVisit, 0, walk.in(kFirst))
      .phase(PhaseKind::kWalk, 0, walk.in(kFirst, kPhaseFrames - 1, shifted(1)));
  const Verdict verdict = judge({walk.get()});
  ASSERT_EQ(verdict.wrong_locks.size(), 1U);
  EXPECT_FALSE(verdict.wrong_locks[0].held);
  EXPECT_FALSE(verdict.passes());
}

TEST(Judge, HeldAtAPlaceWithoutAMapIsNeverExcused) {
  WalkBuilder walk({"a", "b"});
  const auto wrong_at_the_end = [&walk](Trajectory* estimate, Timestamp time, const SE3& pose) {
    walk.in(kFirst, 0, {}, kPhaseFrames - 1)(estimate, time, pose);
    walk.in(kFirst, kPhaseFrames - 1, shifted(1))(estimate, time, pose);
  };
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kVisit, 0, wrong_at_the_end)
      .phase(PhaseKind::kVisit, 1, walk.in(kFirst, 0, shifted(1), 2));
  const Verdict verdict = judge({walk.get()});
  ASSERT_EQ(verdict.wrong_locks.size(), 1U);
  EXPECT_EQ(verdict.wrong_locks[0].frames, 3);
  EXPECT_TRUE(verdict.wrong_locks[0].held);
  EXPECT_TRUE(verdict.wrong_locks[0].at_unmapped);
  EXPECT_FALSE(verdict.wrong_locks[0].excused());
  EXPECT_FALSE(verdict.passes());
}

/// Three places in one map, the second a little off in it and the third in quite another place.
WalkRecord walk_in_one_map() {
  WalkBuilder walk({"a", "b", "c"});
  const auto at = [](int place, double drift) { return shifted(3 * place + drift); };
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kMap, 1, walk.in(kFirst, 0, at(1, 2 * kRightMetres)))
      .phase(PhaseKind::kMap, 2, walk.in(kFirst, 0, at(2, 2 * kMostDrift)))
      .phase(PhaseKind::kVisit, 1, walk.in(kFirst, 5, at(1, 2 * kRightMetres)))
      .phase(PhaseKind::kVisit, 0, walk.in(kFirst, 5, at(1, 2 * kRightMetres)))  // b's part, as if it were b
      .phase(PhaseKind::kVisit, 2, walk.in(kFirst, 5, at(2, 2 * kMostDrift)));
  return walk.get();
}

TEST(Judge, OfAMapOfManyPlacesEachIsJudgedByItself) {
  const Verdict verdict = judge({walk_in_one_map()}, MapExtent::kManyPlaces);
  ASSERT_EQ(verdict.maps.size(), 1U);
  const auto& homes = verdict.maps[0].homes;
  ASSERT_EQ(homes.size(), 2U);  // the third has drifted too far to be one
  EXPECT_EQ(homes[1].place, 1);
  EXPECT_NEAR(homes[1].drift, 2 * kRightMetres, 1e-6);
  EXPECT_EQ(verdict.places_mapped(), 2);
  EXPECT_EQ(verdict.places[1].visits[0].frames_to_lock, 5);
  EXPECT_EQ(verdict.places[1].visits[0].right, kPhaseFrames - 5);
  EXPECT_EQ(verdict.places[0].visits[0].wrong, kPhaseFrames - 5);
  EXPECT_EQ(verdict.places[2].visits[0].wrong, kPhaseFrames - 5);
  EXPECT_NE(verdict_text(verdict).find("is of 2 places; drift in metres from a: b 0.300"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(verdict_json(verdict))["maps"][0]["homes"][1]["place"], "b");
}

TEST(Judge, AMapIsOfOnePlaceUnlessSaidOtherwise) {
  const Verdict verdict = judge({walk_in_one_map()});
  EXPECT_EQ(verdict.maps[0].homes.size(), 1U);
  EXPECT_EQ(verdict.places_mapped(), 1);
  EXPECT_EQ(verdict.places[1].visits[0].wrong, kPhaseFrames - 5);  // off by more than is right
}

TEST(Judge, NothingTrackedIsNothingFound) {
  WalkBuilder walk({"a"});
  walk.phase(PhaseKind::kMap, 0, WalkBuilder::lost).phase(PhaseKind::kVisit, 0, WalkBuilder::lost);
  const Verdict verdict = judge({walk.get()});
  EXPECT_EQ(verdict.places_mapped(), 0);
  EXPECT_EQ(verdict.places_found(), 0);
  EXPECT_FALSE(verdict.passes());
}

TEST(Judge, MapBegunAtTheEndOfAPhaseHasItsFrameFromTheNext) {
  const auto a_little_off = [](WalkBuilder* walk) {
    return [walk](Trajectory* estimate, Timestamp time, const SE3& pose) {
      walk->in(kFirst, kPhaseFrames - 3, shifted(0.01 * std::sin(1e3 * time.seconds())))(estimate, time,
                                                                                         pose);
    };
  };
  WalkBuilder walk({"a"});
  walk.phase(PhaseKind::kWalk, 0, a_little_off(&walk))
      .phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kVisit, 0, walk.in(kFirst));
  EXPECT_TRUE(judge({walk.get()}).passes());
}

TEST(Judge, MapOfAStandingCameraIsNotTakenForRight) {
  WalkBuilder walk({"a"});
  walk.phase(PhaseKind::kMap, 0, [](Trajectory* estimate, Timestamp time, const SE3& /*pose*/) {
    if (estimate->segments.empty()) estimate->segments.push_back({map_id(1), "m", {}});
    estimate->segments.back().poses.push_back({time, SE3()});
  });
  const Verdict verdict = judge({walk.get()});
  ASSERT_EQ(verdict.maps.size(), 1u);
  EXPECT_FALSE(verdict.maps[0].judged);
  EXPECT_EQ(verdict.maps[0].wrong, kPhaseFrames);
}

CameraPtr test_camera() {
  return *make_camera({CameraModel::kPinholeRadtan, 640, 480, {500, 500, 319.5, 239.5, 0, 0, 0, 0, 0}});
}

/// Seen from the side that the cameras of WalkBuilder look at, in the places' frames.
LabelTruth thing_of(const std::string& place) {
  return {place, place_from_camera(30) * Eigen::Vector3d(0.05, -0.02, 1)};
}

/// Places a and b, mapped and visited in maps named as they are, with a thing in each.
WalkRecord labelled_walk() {
  WalkBuilder walk({"a", "b"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst))
      .phase(PhaseKind::kMap, 1, walk.in(kSecond))
      .phase(PhaseKind::kVisit, 0, walk.in(kFirst, 10))
      .phase(PhaseKind::kVisit, 1, walk.in(kSecond, 10, shifted(2 * kRightMetres)));
  WalkRecord record = walk.get();
  for (TrajectorySegment& segment : record.estimate.segments)
    segment.map_name = segment.map == kFirst.id ? "map-a" : "map-b";
  record.camera = test_camera();
  record.things = {thing_of("a"), thing_of("b")};
  return record;
}

PlacedLabel label_of(const MapFrame& map, const std::string& name, const std::string& text,
                     const Eigen::Vector3d& in_home) {
  return {name, text, map.map_from_home * in_home};
}

TEST(JudgeLabels, OneAtItsThingAppearsThereWhateverTheMapsFrame) {
  const Verdict verdict = judge({labelled_walk()}, MapExtent::kOnePlace,
                                std::vector{label_of(kFirst, "map-a", "a", thing_of("a").point),
                                            label_of(kSecond, "map-b", "b", thing_of("b").point)});
  ASSERT_EQ(verdict.labels.size(), 2U);
  EXPECT_EQ(verdict.labels_placed(), 2);
  const std::vector<double>& degrees = verdict.labels[0].degrees;
  ASSERT_FALSE(degrees.empty());
  EXPECT_LT(degrees.back(), 1e-5);
  // In view in some frames only, and only of those that are tracked.
  EXPECT_LT(degrees.size(), static_cast<size_t>(kPhaseFrames - 10) + 1);
  EXPECT_TRUE(verdict.labels[1].degrees.empty()) << "frames with wrong poses tell nothing of labels";
}

TEST(JudgeLabels, OneBesideItsThingIsOffByTheAngleBetween) {
  WalkRecord record = labelled_walk();
  const Eigen::Vector3d beside = thing_of("a").point + Eigen::Vector3d(0.05, 0, 0);
  const Verdict verdict =
      judge({record}, MapExtent::kOnePlace, std::vector{label_of(kFirst, "map-a", "a", beside)});
  const std::vector<double>& degrees = verdict.labels[0].degrees;
  ASSERT_FALSE(degrees.empty());
  EXPECT_TRUE(std::ranges::is_sorted(degrees));
  // 5 cm at about a metre, seen from all sides.
  EXPECT_GT(degrees.front(), 1.5);
  EXPECT_LT(degrees.back(), 5);
}

TEST(JudgeLabels, MissingInTheMapOfAnotherPlaceOrOfAnotherTextIsNotPlaced) {
  const Verdict verdict = judge(
      {labelled_walk()}, MapExtent::kOnePlace,
      std::vector{label_of(kFirst, "map-a", "b", {0, 0, 0}), label_of(kFirst, "map-a", "c", {0, 0, 0})});
  ASSERT_EQ(verdict.labels.size(), 2U);
  EXPECT_EQ(verdict.labels_placed(), 0);
  EXPECT_TRUE(verdict.labels[0].degrees.empty());
}

TEST(JudgeLabels, AreReportedWhereAskedFor) {
  EXPECT_TRUE(judge({labelled_walk()}).labels.empty());
  const Verdict verdict = judge({labelled_walk()}, MapExtent::kOnePlace,
                                std::vector{label_of(kFirst, "map-a", "a", thing_of("a").point)});
  const auto json = nlohmann::json::parse(verdict_json(verdict));
  ASSERT_EQ(json["labels"].size(), 2U);
  EXPECT_EQ(json["labels"][0]["place"], "a");
  EXPECT_EQ(json["labels"][0]["placed"], true);
  EXPECT_EQ(json["labels"][0]["degrees"].size(), verdict.labels[0].degrees.size());
  EXPECT_EQ(json["labels"][1]["placed"], false);
  const std::string text = verdict_text(verdict);
  EXPECT_NE(text.find("labels placed 1 of 2, 0.00 / 0.00 / 0.00"), std::string::npos) << text;
  EXPECT_NE(text.find("not in a map of its place"), std::string::npos) << text;
}

TEST(Judge, ReportsSayWhatTheVerdictSays) {
  WalkBuilder walk({"a", "b"});
  walk.phase(PhaseKind::kMap, 0, walk.in(kFirst)).phase(PhaseKind::kVisit, 1, walk.in(kFirst, 4));
  const Verdict verdict = judge({walk.get()});
  const auto json = nlohmann::json::parse(verdict_json(verdict));
  EXPECT_EQ(json["mapped"], 1);
  EXPECT_EQ(json["found"], 0);
  EXPECT_EQ(json["locks_at_unmapped"], 1);
  EXPECT_EQ(json["wrong_locks"].size(), 1u);
  EXPECT_EQ(json["places"][1]["visits"][0]["wrong"], kPhaseFrames - 4);
  EXPECT_TRUE(json["places"][1]["visits"][0]["frames_to_lock"].is_null());
  const std::string text = verdict_text(verdict);
  EXPECT_NE(text.find("mapped 1 of 1, found at every visit 0 of 1, wrong locks 1"), std::string::npos)
      << text;
}

}  // namespace
}  // namespace cairn
