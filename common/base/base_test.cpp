// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <regex>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/base/result.h"
#include "common/base/suggestion.h"
#include "common/base/time.h"
#include "common/base/version.h"

namespace cairn {
namespace {

TEST(Timestamp, SecondsRoundTripToANanosecond) {
  for (const double s : {0.0, 0.033333, 1305031102.175304, -1.5}) {
    EXPECT_NEAR(Timestamp::from_seconds(s).seconds(), s, std::abs(s) * 1e-15 + 1e-9);
  }
}

TEST(Timestamp, DifferenceUndoesSum) {
  const Timestamp t{1'700'000'000'000'000'001};
  const auto step = std::chrono::nanoseconds(33'333'333);
  EXPECT_EQ((t + step) - t, step);
}

TEST(Result, EveryErrorHasAnExitCodeOfTheContract) {
  EXPECT_EQ(exit_code(ErrorCode::kUsage), 2);
  EXPECT_EQ(exit_code(ErrorCode::kConfiguration), 3);
  EXPECT_EQ(exit_code(ErrorCode::kNoServer), 4);
  EXPECT_EQ(exit_code(ErrorCode::kRefused), 5);
  EXPECT_EQ(exit_code(ErrorCode::kDamaged), 6);
}

TEST(Log, VerbosityChoosesTheLevel) {
  EXPECT_FALSE(make_logger("t", -1)->should_log(spdlog::level::info));
  EXPECT_TRUE(make_logger("t", 0)->should_log(spdlog::level::info));
  EXPECT_TRUE(make_logger("t", 1)->should_log(spdlog::level::debug));
}

TEST(DidYouMean, NamesTheNearestWordWithinHalfTheLength) {
  const std::vector<std::string> valid = {"--profile", "--domain", "--name"};
  for (const std::string& word : valid) EXPECT_EQ(did_you_mean(word, valid), "; did you mean " + word + "?");
  EXPECT_EQ(did_you_mean("--domian", valid), "; did you mean --domain?");
  EXPECT_EQ(did_you_mean("--nam", valid), "; did you mean --name?");
  EXPECT_EQ(did_you_mean("--xyzzy-xyzzy", valid), "");
  EXPECT_EQ(did_you_mean("--name", {}), "");
  EXPECT_EQ(did_you_mean("", valid), "");
}

TEST(RateLimit, IsDueOnceInAnInterval) {
  const RateLimit::TimePoint start{};
  RateLimit limit(std::chrono::milliseconds(100));
  EXPECT_TRUE(limit.due(start));
  EXPECT_FALSE(limit.due(start + std::chrono::milliseconds(99)));
  EXPECT_TRUE(limit.due(start + std::chrono::milliseconds(100)));
  EXPECT_FALSE(limit.due(start + std::chrono::milliseconds(150)));
}

TEST(Version, IsTheProjectsAndTheCommits) {
  const std::regex form(R"(\d+\.\d+\.\d+(\+g[0-9a-f]{8,}(\.dirty)?)?)");
  EXPECT_TRUE(std::regex_match(std::string(version()), form)) << version();
}

}  // namespace
}  // namespace cairn
