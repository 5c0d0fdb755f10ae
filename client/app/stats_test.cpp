// SPDX-License-Identifier: Apache-2.0
#include "client/app/stats.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <random>

#include "client/app/test_doubles.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using testing::at_ms;
using testing::make_frame;

/// Feeds frames as the loop would.
class StatsTest : public ::testing::Test {
 protected:
  void add(FrameState state, MapId map = {}, milliseconds cpu = milliseconds(5),
           milliseconds wall = milliseconds(8)) {
    result_.map = map;
    result_.found = 40;
    result_.attempted = 60;
    result_.reprojection_rms = 0.5;
    const Frame frame = make_frame(number_, at_ms(static_cast<int64_t>(number_) * 33));
    stages_[static_cast<size_t>(Stage::kFine)] = cpu / 2;
    stats_.on_frame(
        {number_++, frame, result_, state, snapshot_, labels_, status_, stages_, cpu, wall, nullptr});
  }
  void drop() { stats_.on_dropped({number_, at_ms(static_cast<int64_t>(number_) * 33)}), ++number_; }
  nlohmann::json json() { return nlohmann::json::parse(stats_.to_json(1234, 5678)); }

  RunStats stats_{RunStats::FrameList::kKept};
  size_t number_ = 0;
  FrameResult result_;
  MapSnapshotPtr snapshot_;
  LabelListPtr labels_;
  SessionStatus status_;
  StageTimes stages_{};
  const MapId desk_{{0xAB}};
  const MapId bench_{{0xCD}};
};

TEST_F(StatsTest, AKeyframesPointsCountFromItsFrameToTheFirstThatHasThem) {
  const auto revision_with = [](const std::vector<uint64_t>& keyframes) {
    auto patches = std::make_shared<PatchBlock>();
    for (const uint64_t keyframe : keyframes) {
      PointSource source;
      source.id = PointId{patches->points.size() + 1};
      source.keyframe = KeyframeId{keyframe};
      patches->points.push_back(source);
    }
    auto block = std::make_shared<PointBlock>();
    block->patches = std::move(patches);
    auto snapshot = std::make_shared<MapSnapshot>();
    snapshot->point_blocks.push_back(std::move(block));
    snapshot->revision = Revision{keyframes.size()};
    return snapshot;
  };
  snapshot_ = revision_with({1, 2});
  add(FrameState::kTracking, desk_);
  stats_.on_offer_replies({{1, true, "", KeyframeId{3}, at_ms(0)}, {2, true, "", KeyframeId{4}, at_ms(0)}});
  stats_.on_offer_replies({{3, false, "too close", {}, at_ms(0)}});
  for (int i = 0; i < 3; ++i) add(FrameState::kTracking, desk_);
  EXPECT_EQ(json()["keyframe_to_points_ms"]["count"], 0);
  snapshot_ = revision_with({1, 2, 3});
  add(FrameState::kTracking, desk_);  // the fifth
  EXPECT_EQ(json()["keyframe_to_points_ms"]["count"], 1) << "4 has none yet";
  EXPECT_NEAR(json()["keyframe_to_points_ms"]["p50"].get<double>(), 4 * 33, 1) << "cells of 1 %";
}

TEST_F(StatsTest, TheContractsKeysCountTheFrames) {
  add(FrameState::kStarting);
  add(FrameState::kStarting);
  add(FrameState::kTracking, desk_);
  add(FrameState::kPoor, desk_);
  drop();
  add(FrameState::kLost, desk_);
  add(FrameState::kTracking, bench_);
  add(FrameState::kTracking, desk_);
  const auto j = json();
  EXPECT_EQ(j["frames_total"], 8);
  EXPECT_EQ(j["tracked"], 4);
  EXPECT_EQ(j["dropped"], 1);
  EXPECT_EQ(j["lost"], 1);
  EXPECT_EQ(j["switches"], 2);
  EXPECT_EQ(j["first_map_frame"], 2);
  EXPECT_EQ(j["bytes_sent"], 1234);
  EXPECT_EQ(j["bytes_received"], 5678);
  EXPECT_EQ(j["frames"].size(), 8U);
  EXPECT_NEAR(j["summary"]["tracked_share"].get<double>(), 4.0 / 6.0, 1e-12);
  EXPECT_NEAR(j["summary"]["reprojection_rms_px"].get<double>(), 0.5, 1e-12);
}

TEST_F(StatsTest, AFrameHasTheContractsFields) {
  add(FrameState::kTracking, desk_, milliseconds(6), milliseconds(9));
  drop();
  const auto frames = json()["frames"];
  EXPECT_EQ(frames[0]["state"], "tracking");
  EXPECT_EQ(frames[0]["map"], to_hex(desk_.bytes));
  EXPECT_EQ(frames[0]["inliers"], 40);
  EXPECT_EQ(frames[0]["attempted"], 60);
  EXPECT_DOUBLE_EQ(frames[0]["cpu_ms"], 6);
  EXPECT_DOUBLE_EQ(frames[0]["wall_ms"], 9);
  EXPECT_EQ(frames[1]["state"], "dropped");
  EXPECT_DOUBLE_EQ(frames[1]["t"], 0.033);
  EXPECT_TRUE(frames[1]["map"].is_null());
}

TEST_F(StatsTest, AnAnswerHasTheFrameThatWasAskedAboutAndItsBestPlace) {
  RelocalizationAnswer answer;
  answer.verdict = RelocalizationVerdict::kUnconfirmed;
  answer.candidates.resize(2);
  answer.candidates[0].map = bench_;
  answer.candidates[1].map = desk_;
  stats_.on_relocalization_answer({3, at_ms(66), answer, true});
  answer.verdict = RelocalizationVerdict::kNotKnown;  // these are what was looked at in vain
  stats_.on_relocalization_answer({5, at_ms(133), answer, false});
  const auto answers = json()["answers"];
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_DOUBLE_EQ(answers[0]["t"], 0.066);
  EXPECT_EQ(answers[0]["verdict"], "unconfirmed");
  EXPECT_EQ(answers[0]["map"], to_hex(bench_.bytes));
  EXPECT_EQ(answers[0]["tried"], true);
  EXPECT_EQ(answers[1]["verdict"], "not known");
  EXPECT_TRUE(answers[1]["map"].is_null());
  EXPECT_EQ(answers[1]["tried"], false);
}

TEST_F(StatsTest, PercentilesAreOverTrackedFramesOnly) {
  add(FrameState::kStarting, {}, milliseconds(900));
  for (int i = 1; i <= 100; ++i) add(FrameState::kTracking, desk_, milliseconds(i));
  add(FrameState::kLost, desk_, milliseconds(900));
  const auto stages = json()["stages_ms"];
  EXPECT_NEAR(stages["total"]["p50"].get<double>(), 50, 0.3);
  EXPECT_NEAR(stages["total"]["p95"].get<double>(), 95, 0.5);
  EXPECT_NEAR(stages["total"]["p99"].get<double>(), 99, 0.5);
  EXPECT_NEAR(stages[to_string(Stage::kFine)]["p50"].get<double>(), 25, 0.15);
  EXPECT_EQ(stages.size(), kStageCount + 1);
}

TEST_F(StatsTest, StartingAndLostFramesHaveFiguresOfTheirOwn) {
  EXPECT_EQ(json()["starting_ms"]["count"], 0);
  for (int i = 1; i <= 100; ++i) {
    add(FrameState::kStarting, {}, milliseconds(i));
    add(FrameState::kTracking, desk_, milliseconds(900));
    add(FrameState::kLost, desk_, milliseconds(2 * i));
  }
  drop();
  const auto j = json();
  EXPECT_NEAR(j["starting_ms"]["p95"].get<double>(), 95, 0.5);
  EXPECT_NEAR(j["lost_ms"]["p95"].get<double>(), 190, 1);
  EXPECT_EQ(j["starting_ms"]["count"], 100);
  EXPECT_EQ(j["lost_ms"]["count"], 100);
}

TEST_F(StatsTest, DroppedFramesAreLate) {
  add(FrameState::kStarting, {}, milliseconds(5), milliseconds(33));
  add(FrameState::kTracking, desk_, milliseconds(5), milliseconds(34));
  drop();
  add(FrameState::kTracking, desk_);
  EXPECT_NEAR(json()["summary"]["on_time_share"].get<double>(), 0.5, 1e-12);
}

TEST_F(StatsTest, ARotationIsToldByItselfAndIsNoPose) {
  add(FrameState::kTracking, desk_);
  result_.camera_from_map = SE3(so3_exp({0, 0.5, 0}), Eigen::Vector3d(1, 2, 3));
  add(FrameState::kRotation, desk_);
  const auto j = json();
  EXPECT_EQ(j["tracked"], 1);
  EXPECT_EQ(j["rotation"], 1);
  EXPECT_EQ(j["lost"], 0);
  EXPECT_NEAR(j["summary"]["on_time_share"].get<double>(), 0.5, 1e-12);
  EXPECT_FALSE(j["frames"][0].contains("rotation"));
  EXPECT_EQ(j["frames"][1]["map"], to_hex(desk_.bytes));
  const auto q = j["frames"][1]["rotation"].get<std::vector<double>>();
  ASSERT_EQ(q.size(), 4U);
  EXPECT_NEAR(q[1], -std::sin(0.25), 1e-12) << "map_from_camera";
  EXPECT_NEAR(q[3], std::cos(0.25), 1e-12);
}

TEST_F(StatsTest, AnUndecodableFrameCountsAsNotTracked) {
  add(FrameState::kTracking, desk_);
  const std::string reason = "1.png: cut";
  stats_.on_undecodable({number_++, reason});
  const auto j = json();
  EXPECT_EQ(j["frames_total"], 2);
  EXPECT_EQ(j["dropped"], 1);
  EXPECT_EQ(j["summary"]["undecodable"], 1);
  EXPECT_NEAR(j["summary"]["tracked_share"].get<double>(), 0.5, 1e-12);
  EXPECT_EQ(stats_.frames_decoded(), 1U);
}

TEST_F(StatsTest, WithoutAMapThereIsNoFirstMapFrame) {
  add(FrameState::kStarting);
  EXPECT_TRUE(json()["first_map_frame"].is_null());
  EXPECT_THAT(stats_.summary_lines(), ::testing::Contains("no map was begun or found"));
}

TEST_F(StatsTest, AMapThatWasNeverTrackedInIsNoSuccess) {
  add(FrameState::kStarting);
  add(FrameState::kLost);
  add(FrameState::kLost);
  EXPECT_EQ(json()["first_map_frame"], 1);
  EXPECT_EQ(json()["summary"]["tracked_share"], 0);
  EXPECT_THAT(stats_.summary_lines(), ::testing::Contains("in a map from frame 1, never tracked"));
}

TEST_F(StatsTest, WithoutTheListsTheFiguresAreTheSame) {
  RunStats counts(RunStats::FrameList::kLeftOut);
  const Frame frame = make_frame(0, at_ms(0));
  const auto add_to_both = [&](FrameState state) {
    counts.on_frame({0, frame, result_, state, snapshot_, labels_, status_, stages_, milliseconds(5),
                     milliseconds(8), nullptr});
    stats_.on_frame({0, frame, result_, state, snapshot_, labels_, status_, stages_, milliseconds(5),
                     milliseconds(8), nullptr});
  };
  for (const FrameState state : {FrameState::kStarting, FrameState::kTracking, FrameState::kLost}) {
    add_to_both(state);
  }
  for (RunStats* stats : {&counts, &stats_})
    stats->on_relocalization_answer({1, at_ms(0), RelocalizationAnswer{}, false});
  auto kept = json();
  auto left_out = nlohmann::json::parse(counts.to_json(1234, 5678));
  EXPECT_EQ(kept["frames"].size(), 3U);
  EXPECT_EQ(kept["answers"].size(), 1U);
  for (const char* list : {"frames", "answers"}) {
    EXPECT_TRUE(left_out[list].empty());
    kept.erase(list);
    left_out.erase(list);
  }
  EXPECT_EQ(kept, left_out);
  EXPECT_EQ(stats_.summary_lines(), counts.summary_lines());
}

TEST(StageClock, CountsTheThreadsProcessorTimeOfAStageAndStartsAgain) {
  StageClock clock;
  const auto before = thread_cpu_time();
  clock.begin(Stage::kFine);
  volatile double sink = 0;
  while (thread_cpu_time() - before < milliseconds(2)) sink = sink + 1;
  clock.end(Stage::kFine);
  const auto times = clock.take();
  EXPECT_GE(times[static_cast<size_t>(Stage::kFine)], milliseconds(1));
  EXPECT_EQ(times[static_cast<size_t>(Stage::kPose)].count(), 0);
  EXPECT_EQ(clock.take()[static_cast<size_t>(Stage::kFine)].count(), 0);
}

TEST_F(StatsTest, ARunThatBroughtNoPosesOrDroppedMostSaysSo) {
  EXPECT_FALSE(stats_.shortfall("why"));  // no frame at all is the source's fault
  add(FrameState::kStarting);
  EXPECT_THAT(stats_.shortfall("too little parallax").value_or(""),
              ::testing::AllOf(::testing::HasSubstr("without a map"), ::testing::HasSubstr("parallax")));
  add(FrameState::kLost);
  EXPECT_THAT(stats_.shortfall("").value_or(""), ::testing::HasSubstr("never tracked"));
  for (int i = 0; i < 3; ++i) drop();
  EXPECT_THAT(stats_.shortfall("").value_or(""),
              ::testing::AllOf(::testing::HasSubstr("never tracked"), ::testing::HasSubstr("3 of 5")));
  for (int i = 0; i < 3; ++i) add(FrameState::kPoor, desk_);
  EXPECT_FALSE(stats_.shortfall("why"));
  for (int i = 0; i < 2; ++i) drop();
  EXPECT_FALSE(stats_.shortfall(""));  // half is not most
  drop();
  EXPECT_THAT(stats_.shortfall("").value_or(""), ::testing::HasSubstr("6 of 11"));
}

TEST_F(StatsTest, FramesThatCouldNotBeDecodedAreNotDroppedOnes) {
  add(FrameState::kTracking, desk_);
  const std::string reason = "damaged";
  for (size_t i = 1; i < 10; ++i) stats_.on_undecodable({i, reason});
  EXPECT_FALSE(stats_.shortfall(""));
}

}  // namespace
}  // namespace cairn
