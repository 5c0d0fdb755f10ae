// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_gate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <string>

namespace cairn {
namespace {

using Admission = AdminGate::Admission;
using ::testing::HasSubstr;

constexpr SessionId kSession{7};

class AdminGateTest : public ::testing::Test {
 protected:
  [[nodiscard]] AdminGate::Judgement ask(const std::string& name, uint64_t seq) {
    now_ += std::chrono::seconds(1);
    return gate_.admit(name, {kSession, seq}, now_);
  }
  void answer(const std::string& name, uint64_t seq) {
    wire::AdminReply reply;
    reply.command = {kSession, seq};
    gate_.answered(name, reply, now_);
  }

  [[nodiscard]] const wire::AdminReply* last(const std::string& name) const {
    return gate_.last({name, kSession});
  }

  AdminGate gate_;
  MonotonicTime now_{};
};

TEST_F(AdminGateTest, ARequestIsCarriedOutOnceAndItsAnswerRepeated) {
  EXPECT_EQ(ask("ann", 1).admission, Admission::kNew);
  EXPECT_EQ(ask("ann", 1).admission, Admission::kInWork);
  answer("ann", 1);
  EXPECT_EQ(ask("ann", 1).admission, Admission::kRepeated);
  ASSERT_NE(last("ann"), nullptr);
  EXPECT_EQ(last("ann")->command.seq, 1U);
  EXPECT_EQ(last("bob"), nullptr);
}

TEST_F(AdminGateTest, ARequestThatIsOvertakenOnItsWayIsNotCarriedOutAgain) {
  for (const uint64_t seq : {1, 2}) {
    EXPECT_EQ(ask("ann", seq).admission, Admission::kNew);
    answer("ann", seq);
  }
  EXPECT_EQ(ask("ann", 1).admission, Admission::kInWork) << "nothing follows";
  EXPECT_EQ(last("ann")->command.seq, 2U);
  EXPECT_EQ(ask("ann", 3).admission, Admission::kNew);
}

TEST_F(AdminGateTest, WhoSendsRequestsWithoutWaitingIsRefusedAllButTheFirst) {
  EXPECT_EQ(ask("ann", 1).admission, Admission::kNew);
  for (uint64_t seq = 2; seq < 10'000; ++seq) {
    const auto refused = ask("ann", seq);
    ASSERT_EQ(refused.admission, Admission::kRefused);
    EXPECT_THAT(refused.why, HasSubstr("an earlier request of yours"));
    answer("ann", seq);
    ASSERT_EQ(ask("ann", seq).admission, Admission::kRepeated);
    ASSERT_EQ(ask("ann", 1).admission, Admission::kInWork) << "it is not forgotten over that";
  }
  answer("ann", 1);
  EXPECT_EQ(ask("ann", 10'000).admission, Admission::kNew);
}

TEST_F(AdminGateTest, WhoWasAnsweredLateIsNotTheFirstToBeForgotten) {
  EXPECT_EQ(ask("long", 1).admission, Admission::kNew);
  for (size_t i = 1; i < AdminGate::kMostRuns; ++i) {
    const std::string name = "op-" + std::to_string(i);
    ASSERT_EQ(ask(name, 1).admission, Admission::kNew);
    answer(name, 1);
  }
  answer("long", 1);
  EXPECT_EQ(ask("one-more", 1).admission, Admission::kNew);
  ASSERT_NE(last("long"), nullptr) << "it may not have its answer yet";
  EXPECT_EQ(last("op-1"), nullptr);
}

TEST_F(AdminGateTest, FewAreUnderWayAtATimeHoweverManyAsk) {
  std::mt19937 random(5);
  std::map<std::string, uint64_t> at_work;
  for (uint64_t seq = 1; seq < 5'000; ++seq) {
    const std::string name = "op-" + std::to_string(random() % 200);
    const auto judged = ask(name, seq);
    if (judged.admission == Admission::kNew) {
      EXPECT_TRUE(at_work.emplace(name, seq).second);
    }
    if (judged.admission == Admission::kRefused) {
      EXPECT_TRUE(at_work.contains(name) || at_work.size() == AdminGate::kMostInWork) << judged.why;
      answer(name, seq);
      EXPECT_EQ(last(name)->command.seq, seq) << "it is told";
    }
    ASSERT_LE(at_work.size(), AdminGate::kMostInWork);
    for (const auto& [busy, its] : at_work)
      ASSERT_TRUE(gate_.knows({busy, kSession})) << "it would be done twice";
    if (random() % 3 == 0 && !at_work.empty()) {
      const auto first = at_work.begin();
      answer(first->first, first->second);
      at_work.erase(first);
    }
  }
}

TEST_F(AdminGateTest, OneOperatorWithManyRunsLeavesRoomForOthers) {
  for (uint64_t run = 1; run <= 3 * AdminGate::kMostRuns; ++run) {
    now_ += std::chrono::seconds(1);
    if (run == 10) {
      EXPECT_EQ(ask("ann", 1).admission, Admission::kNew) << "another has a place";
      answer("ann", 1);
    }
    const wire::CommandId command{SessionId{100 + run}, 1};
    const auto judged = gate_.admit("greedy", command, now_);
    EXPECT_EQ(judged.admission, run <= AdminGate::kMostInWorkOfOne ? Admission::kNew : Admission::kRefused);
    if (judged.admission != Admission::kRefused) continue;
    EXPECT_THAT(judged.why, HasSubstr("4 requests of operator greedy are under way"));
    wire::AdminReply reply;
    reply.command = command;
    gate_.answered("greedy", reply, now_);
  }
  EXPECT_NE(last("ann"), nullptr) << "whoever has many runs has his own forgotten";
}

}  // namespace
}  // namespace cairn
