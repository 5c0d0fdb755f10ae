// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/line_fold.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace cairn::wire::internal {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

class LineFoldTest : public ::testing::Test {
 protected:
  void say(const std::string& text, uint32_t place = 1) {
    note(fold_.take("a.c", place, {text, true}, now_));
  }
  void note(const std::vector<LineFold::Said>& lines) {
    for (const auto& line : lines) said_.push_back(line.text);
  }

  LineFold fold_{10};
  LineFold::TimePoint now_{1h};
  std::vector<std::string> said_;
};

/// As a cable that is cut for 8 s: each line names another peer and port.
TEST_F(LineFoldTest, LinesThatDifferInAPortAreOneKind) {
  for (int i = 0; i < 80; ++i) {
    say("write to udp/10.77.0.2:" + std::to_string(7000 + i) + " failed");
    now_ += 100ms;
  }
  EXPECT_EQ(said_.size(), LineFold::kLinesOfAPlace);
  note(fold_.rest());
  EXPECT_EQ(said_.back(), "… and 77 more like it, the last: write to udp/10.77.0.2:7079 failed");
  note(fold_.rest());
  EXPECT_EQ(said_.size(), LineFold::kLinesOfAPlace + 1) << "told once";
}

TEST_F(LineFoldTest, WhatWasFoldedIsToldWithTheNextLineOfAnyKind) {
  for (int i = 0; i < 50; ++i) say("is away");
  EXPECT_EQ(said_.size(), 1U);
  say("something else", 2);
  EXPECT_EQ(said_.size(), 2U) << "not before the interval is over: there may be more";
  now_ += LineFold::kInterval;
  say("and another", 3);
  ASSERT_EQ(said_.size(), 4U);
  EXPECT_THAT(said_[2], HasSubstr("and 49 more like it"));
  say("is away");
  EXPECT_EQ(said_.back(), "is away") << "an interval of its own";
}

TEST_F(LineFoldTest, EveryLineIsToldOrCounted) {
  constexpr int kLines = 1000;
  int told = 0;
  for (uint32_t i = 0; i < kLines; ++i) {
    say("line " + std::to_string(i % 17), i % 5);
    now_ += std::chrono::milliseconds(i % 400);
  }
  note(fold_.rest());
  for (const std::string& text : said_) {
    const size_t at = text.find("and ");
    told += at == std::string::npos ? 1 : std::stoi(text.substr(at + 4));
  }
  EXPECT_EQ(told, kLines);
}

TEST_F(LineFoldTest, ManyKindsAtOnceAreHeldToSoManyASecond) {
  for (uint32_t place = 0; place < 100; ++place) say("rubbish", place);
  EXPECT_EQ(said_.size(), 10U);
}

}  // namespace
}  // namespace cairn::wire::internal
