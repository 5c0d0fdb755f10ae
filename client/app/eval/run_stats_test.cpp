// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/run_stats.h"

#include <gmock/gmock.h>

#include <string>

namespace cairn {
namespace {

using ::testing::HasSubstr;

std::string frame(const std::string& state, double cpu_ms, double wall_ms) {
  return R"({"t": 1.5, "state": ")" + state +
         R"(", "map": null, "inliers": 10, "attempted": 20, "cpu_ms": )" + std::to_string(cpu_ms) +
         R"(, "wall_ms": )" + std::to_string(wall_ms) + "}";
}

std::string document(int frames_total, const std::string& first_map_frame,
                     const std::vector<std::string>& frames) {
  std::string list;
  for (const auto& entry : frames) list += (list.empty() ? "" : ",") + entry;
  return R"({"frames_total": )" + std::to_string(frames_total) +
         R"(, "tracked": 0, "dropped": 0, "lost": 0, "switches": 2,
    "first_map_frame": )" +
         first_map_frame + R"(, "bytes_sent": 100, "bytes_received": 7, "stages_ms": {}, "frames": [)" +
         list + "]}";
}

TEST(RunStats, PercentagesAreOverAllFramesAfterTheFirstMap) {
  std::vector<std::string> frames = {frame("starting", 1, 1), frame("starting", 1, 1)};
  for (int i = 0; i < 5; ++i) frames.push_back(frame("tracking", 3, 5));
  frames.push_back(frame("poor", 4, 33));
  frames.push_back(frame("lost", 5, 33.1));
  frames.push_back(frame("dropped", 0, 0));
  frames.push_back(frame("rotation", 5, 5));
  const auto run = summarize_run(document(11, "2", frames));
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ(run->frames_after_map, 9);
  EXPECT_EQ(run->tracked, 6);
  EXPECT_EQ(run->poor, 1);
  EXPECT_EQ(run->lost, 1);
  EXPECT_EQ(run->dropped, 1);
  EXPECT_EQ(run->switches, 2);
  EXPECT_EQ(run->bytes_sent, 100);
  EXPECT_DOUBLE_EQ(run->tracked_percent, 100 * 6 / 9.0);
  EXPECT_DOUBLE_EQ(run->on_time_percent, 100 * 8 / 11.0)
      << "not the lost one (33.1 ms), the dropped one, and the one without a position";
  EXPECT_NEAR(run->cpu_ms.p50, 3, 0.02);
  EXPECT_NEAR(run->cpu_ms.p99, 4, 0.02) << "of tracked frames only";
}

TEST(RunStats, ARunThatWasCutDoesNotLookBetterForIt) {
  const auto run = summarize_run(document(100, "0", {frame("tracking", 1, 1)}));
  ASSERT_TRUE(run);
  EXPECT_DOUBLE_EQ(run->tracked_percent, 1);
  EXPECT_DOUBLE_EQ(run->on_time_percent, 1);
}

TEST(RunStats, NoMapIsNoTracking) {
  for (const auto* none : {"null", "-1"}) {
    const auto run = summarize_run(document(2, none, {frame("starting", 1, 1), frame("starting", 1, 1)}));
    ASSERT_TRUE(run);
    EXPECT_FALSE(run->first_map_frame);
    EXPECT_EQ(run->tracked_percent, 0);
    EXPECT_EQ(run->on_time_percent, 100);
  }
}

TEST(RunStats, WhatIsNotAStatsFileIsNamed) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"", "parse error"},
      {"[]", "not a --stats file"},
      {"{}", "frames"},
      {document(1, "0", {frame("flying", 1, 1)}), "flying"},
      {document(0, "0", {frame("lost", 1, 1)}), "frames_total"},
      {document(1, "1", {frame("lost", 1, 1)}), "first_map_frame"},
      {document(1, "\"x\"", {frame("lost", 1, 1)}), "type"},
      {document(1, "0", {"{\"state\": \"lost\"}"}), "cpu_ms"}};
  for (const auto& [text, part] : cases) {
    const auto run = summarize_run(text);
    ASSERT_FALSE(run) << text;
    EXPECT_EQ(run.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(run.error().message, HasSubstr(part));
  }
}

}  // namespace
}  // namespace cairn
