// SPDX-License-Identifier: Apache-2.0
#include "server/service/rig_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/service/admin_json.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using wire::RigMode;

class RigListTest : public ::testing::Test {
 protected:
  RigListTest() { state_.rig = "shoulder"; }
  std::vector<std::string> hear() { return rigs_.heard(state_, now_); }
  /// The rig has judged an order.
  void order(const std::string& who, uint64_t session, uint64_t number, RigMode mode) {
    state_.order = {{session}, number};
    state_.ordered_by = who;
    state_.ordered = mode;
  }

  RigList rigs_;
  wire::RigState state_;
  MonotonicTime now_{1h};
};

TEST_F(RigListTest, EachOrderIsOnRecordOnceWithWhoGaveItAndWhatBecameOfIt) {
  EXPECT_THAT(hear(), ElementsAre("rig shoulder: it is there"));
  EXPECT_THAT(hear(), IsEmpty());
  order("tracker-3", 5, 1, RigMode::kLock);
  EXPECT_THAT(hear(), ElementsAre("rig shoulder: tracker-3 ordered lock"));
  EXPECT_THAT(hear(), IsEmpty());
  order("ada-71", 6, 1, RigMode::kNeutral);
  state_.refusal = "the rig is commanded by tracker-3";
  EXPECT_THAT(
      hear(),
      ElementsAre("rig shoulder: ada-71 ordered neutral, refused: the rig is commanded by tracker-3"));
  order("ada-71", 6, 4, RigMode::kStop);
  state_.refusal.clear();
  state_.stopped = true;
  EXPECT_THAT(hear(),
              ElementsAre("rig shoulder: ada-71 ordered stop (orders before it were not heard here: 2)",
                          "rig shoulder: it is in emergency stop"));
}

TEST_F(RigListTest, AStopAtTheRigItselfAndWhatIsInItsWayAreOnRecord) {
  (void)hear();
  state_.stopped = true;
  state_.trouble = "emergency stop; clear it by the name shoulder";
  EXPECT_THAT(hear(), ElementsAre("rig shoulder: it is in emergency stop",
                                  "rig shoulder: emergency stop; clear it by the name shoulder"));
  state_.stopped = false;
  state_.trouble.clear();
  EXPECT_THAT(hear(), ElementsAre("rig shoulder: its emergency stop is over",
                                  "rig shoulder: nothing keeps it from moving any more"));
}

TEST_F(RigListTest, OneThatIsSilentIsToldSoAndForgottenLater) {
  (void)hear();
  now_ += RigList::kSilent;
  EXPECT_THAT(rigs_.pass(now_), IsEmpty());
  now_ += 1ms;
  EXPECT_THAT(rigs_.pass(now_), ElementsAre("rig shoulder: it is silent"));
  EXPECT_THAT(rigs_.pass(now_), IsEmpty());
  EXPECT_TRUE(rigs_.seen(now_).at(0).silent);
  EXPECT_THAT(hear(), ElementsAre("rig shoulder: it is there"));
  EXPECT_FALSE(rigs_.seen(now_).at(0).silent);
  now_ += RigList::kForgotten + 1ms;
  (void)rigs_.pass(now_);
  EXPECT_TRUE(rigs_.seen(now_).empty());
}

TEST_F(RigListTest, WhatItDoesIsListed) {
  order("tracker-3", 5, 1, RigMode::kLock);
  state_.mode = RigMode::kLock;
  state_.commander = "tracker-3";
  state_.drives_idle = false;
  state_.axes[1].fault = 3;
  state_.trouble = "tilt (node 17) is stuck";
  (void)hear();
  now_ += 500ms;
  const nlohmann::json expected = {
      {"rig", "shoulder"},        {"mode", "lock"},
      {"commander", "tracker-3"}, {"stopped", false},
      {"drives_idle", false},     {"faults", {{"pan", 0}, {"tilt", 3}}},
      {"silent", false},          {"trouble", "tilt (node 17) is stuck"},
      {"heard_s_ago", 0.5},       {"last_order", {{"by", "tracker-3"}, {"mode", "lock"}, {"refusal", ""}}}};
  EXPECT_EQ(content_of(told::Rigs{rigs_.seen(now_)})["rigs"], nlohmann::json::array({expected}));
}

TEST_F(RigListTest, AnybodyMaySayToBeARigAndOnlySoManyAreHeard) {
  for (size_t i = 0; i < RigList::kMost + 10; ++i) {
    state_.rig = "rig-" + std::to_string(i);
    (void)hear();
  }
  EXPECT_EQ(rigs_.seen(now_).size(), RigList::kMost);
}

}  // namespace
}  // namespace cairn
