// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "server/service/command_gate.h"
#include "server/service/presence.h"

namespace cairn {
namespace {

constexpr unsigned kSeed = 90125;
constexpr SessionId kSession{42};

wire::OfferOutcome outcome(uint64_t seq) {
  wire::OfferOutcome made;
  made.seq = seq;
  return made;
}

TEST(OfferGate, AppliesEachOfferOnceInOrderHoweverTheyAreRepeatedAndDecided) {
  std::mt19937 random(kSeed);
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  OfferGate gate;
  gate.enter_session(kSession);
  ASSERT_EQ(gate.admit(1), OfferGate::Admission::kNew);  // 1 repeatedly left out: a forgotten client, below
  std::vector<uint64_t> judged{1};
  std::vector<uint64_t> in_work{1};
  while (gate.verdict({}).last_decided < 200) {
    const uint64_t decided = gate.verdict({}).last_decided;
    const uint64_t seq = std::uniform_int_distribution<uint64_t>(decided > 3 ? decided - 3 : 0,
                                                                 decided + OfferGate::kCredit)(random);
    const auto admission = gate.admit(seq);
    EXPECT_NE(admission, OfferGate::Admission::kNoCredit);
    if (admission == OfferGate::Admission::kNew) {
      judged.push_back(seq);
      in_work.push_back(seq);
    }
    if (!in_work.empty() && random() % 2 == 0) {
      std::shuffle(in_work.begin(), in_work.end(), random);  // maps work in parallel
      gate.decide(kSession, outcome(in_work.back()));
      EXPECT_NE(gate.admit(in_work.back()), OfferGate::Admission::kNew);
      in_work.pop_back();
    }
    ASSERT_LE(in_work.size(), OfferGate::kCredit);
  }
  for (size_t i = 0; i < judged.size(); ++i) ASSERT_EQ(judged[i], i + 1);
  const wire::OfferVerdict verdict = gate.verdict({});
  ASSERT_EQ(verdict.recent.size(), OfferGate::kRecent);
  for (size_t i = 1; i < verdict.recent.size(); ++i) {
    EXPECT_EQ(verdict.recent[i].seq, verdict.recent[i - 1].seq + 1);
  }
  EXPECT_EQ(verdict.recent.back().seq, verdict.last_decided);
}

TEST(OfferGate, WhatIsBeyondTheCreditIsSaidToBe) {
  OfferGate gate;
  gate.enter_session(kSession);
  for (uint64_t seq = 1; seq <= OfferGate::kCredit; ++seq)
    EXPECT_EQ(gate.admit(seq), OfferGate::Admission::kNew);
  EXPECT_EQ(gate.admit(OfferGate::kCredit + 1), OfferGate::Admission::kNoCredit);
  EXPECT_EQ(gate.admit(OfferGate::kCredit + 3), OfferGate::Admission::kGap);
  EXPECT_EQ(gate.admit(2), OfferGate::Admission::kInFlight);
}

TEST(OfferGate, ANewSessionCountsAnewAndForgetsLateDecisions) {
  OfferGate gate;
  gate.enter_session(kSession);
  EXPECT_EQ(gate.admit(1), OfferGate::Admission::kNew);
  gate.enter_session(SessionId{43});
  gate.decide(kSession, outcome(1));
  EXPECT_EQ(gate.verdict({}).last_decided, 0U);
  EXPECT_EQ(gate.verdict({}).session, SessionId{43});
  EXPECT_EQ(gate.admit(1), OfferGate::Admission::kNew);
  gate.enter_session(SessionId{43});
  EXPECT_EQ(gate.admit(1), OfferGate::Admission::kInFlight)
      << "entering the same session again changes nothing";
}

TEST(OfferGate, WhatWaitsIsBoundedHoweverManyAreSent) {
  OfferGate gate;
  gate.enter_session(kSession);
  ASSERT_EQ(gate.admit(1), OfferGate::Admission::kNew);  // in work all the time
  uint64_t seq = 2;
  while (seq < 1000) {
    const auto admission = gate.admit(seq);
    if (admission == OfferGate::Admission::kGap) break;
    gate.decide(kSession, outcome(seq++));
  }
  EXPECT_EQ(seq, OfferGate::kMaxAhead + 1);
  gate.decide(kSession, outcome(1));
  EXPECT_EQ(gate.verdict({}).last_decided, OfferGate::kMaxAhead);
  EXPECT_EQ(gate.admit(seq), OfferGate::Admission::kNew) << "sent again when there is room";
}

TEST(OfferGate, AForgottenClientGoesOnWithWhatItSendsAgain) {
  OfferGate gate;
  gate.enter_session(kSession);
  EXPECT_EQ(gate.admit(58), OfferGate::Admission::kGap) << "57 may be on its way";
  for (int times = 1; times < OfferGate::kSentAgain; ++times) {
    EXPECT_EQ(gate.admit(57), OfferGate::Admission::kGap);
    EXPECT_EQ(gate.admit(58), OfferGate::Admission::kGap);
  }
  EXPECT_EQ(gate.admit(57), OfferGate::Admission::kNew);
  EXPECT_EQ(gate.admit(58), OfferGate::Admission::kNew);
  EXPECT_EQ(gate.verdict({}).last_decided, 56U);
  gate.decide(kSession, outcome(57));
  EXPECT_EQ(gate.verdict({}).last_decided, 57U);
  EXPECT_EQ(gate.admit(57), OfferGate::Admission::kRepeated);
}

std::vector<wire::OfferOutcome> outcomes(std::initializer_list<uint64_t> seqs) {
  std::vector<wire::OfferOutcome> made;
  for (const uint64_t seq : seqs) made.push_back(outcome(seq));
  return made;
}

TEST(OfferGate, ARestoredGateAnswersWhatWasDecidedAndJudgesWhatIsMissing) {
  OfferGate gate;
  gate.resume(kSession, outcomes({1, 2, 3, 5, 6, 8}));
  gate.enter_session(kSession);
  EXPECT_EQ(gate.verdict({}).last_decided, 6U) << "4 lies a credit before 8: the client had its decision";
  EXPECT_EQ(gate.admit(5), OfferGate::Admission::kRepeated);
  EXPECT_EQ(gate.admit(8), OfferGate::Admission::kRepeated);
  EXPECT_EQ(gate.admit(7), OfferGate::Admission::kNew);
  EXPECT_EQ(gate.admit(9), OfferGate::Admission::kNew) << "8 needs no judgement";
  gate.decide(kSession, outcome(9));
  gate.decide(kSession, outcome(7));
  EXPECT_EQ(gate.verdict({}).last_decided, 9U);
  EXPECT_EQ(gate.verdict({}).recent.back().seq, 9U);
}

TEST(OfferGate, ARestoredGateThatLacksRefusalsFollowsTheClient) {
  OfferGate gate;
  gate.resume(kSession, outcomes({10}));  // 7 to 9 were refused, the client knows it, we do not
  for (int times = 1; times < OfferGate::kSentAgain; ++times)
    EXPECT_EQ(gate.admit(10), OfferGate::Admission::kRepeated);
  EXPECT_EQ(gate.verdict({}).last_decided, 6U);
  EXPECT_EQ(gate.admit(10), OfferGate::Admission::kRepeated);
  EXPECT_EQ(gate.verdict({}).last_decided, 10U) << "now the client learns of it";
  EXPECT_EQ(gate.verdict({}).recent.back().seq, 10U);
  EXPECT_EQ(gate.admit(11), OfferGate::Admission::kNew);

  OfferGate behind;
  behind.resume(kSession, outcomes({10}));
  for (int times = 1; times < OfferGate::kSentAgain; ++times)
    EXPECT_EQ(behind.admit(13), OfferGate::Admission::kGap);
  EXPECT_EQ(behind.admit(13), OfferGate::Admission::kNew);
  EXPECT_EQ(behind.verdict({}).last_decided, 12U);
}

TEST(OfferGate, ANumberThatComesLateAndNotAgainDoesNotHoldUpWhatTheClientSends) {
  OfferGate gate;
  gate.resume(kSession, outcomes({4}));
  EXPECT_EQ(gate.admit(6), OfferGate::Admission::kGap) << "sent before the restart, decided since";
  int times = 0;
  while (gate.admit(9) == OfferGate::Admission::kGap) ASSERT_LT(++times, 100);
  EXPECT_EQ(gate.verdict({}).last_decided, 8U);
}

TEST(OfferGate, ALateNumberThatIsTakenInAnewDoesNotEither) {
  OfferGate gate;
  gate.resume(kSession, outcomes({1, 2, 3, 4}));
  EXPECT_EQ(gate.admit(5), OfferGate::Admission::kNew) << "it was refused before the restart";
  int times = 0;
  EXPECT_EQ(gate.admit(9), OfferGate::Admission::kGap);
  gate.decide(kSession, outcome(5));
  while (gate.admit(9) == OfferGate::Admission::kGap) ASSERT_LT(++times, 100);
  EXPECT_GE(times, OfferGate::kSentAgain) << "6 to 8 may be on their way";
  EXPECT_EQ(gate.verdict({}).last_decided, 8U);
  gate.decide(kSession, outcome(9));
  EXPECT_EQ(gate.verdict({}).last_decided, 9U);
}

TEST(SeedGate, ARestoredGateRepeatsItsVerdict) {
  wire::SeedVerdict verdict;
  verdict.command = {kSession, 3};
  verdict.accepted = true;
  SeedGate gate;
  gate.resume(verdict);
  gate.enter_session(kSession);
  EXPECT_EQ(gate.admit(3), SeedGate::Admission::kRepeated);
  EXPECT_TRUE(gate.verdict().accepted);
  EXPECT_EQ(gate.admit(2), SeedGate::Admission::kSuperseded);
  EXPECT_EQ(gate.admit(4), SeedGate::Admission::kNew);
}

TEST(SeedGate, JudgesTheNewestOnceAndRepeatsItsVerdict) {
  SeedGate gate;
  gate.enter_session(kSession);
  EXPECT_EQ(gate.admit(0), SeedGate::Admission::kSuperseded);
  EXPECT_EQ(gate.admit(3), SeedGate::Admission::kNew) << "seeds superseded before they were sent leave gaps";
  EXPECT_EQ(gate.admit(3), SeedGate::Admission::kInFlight);
  EXPECT_EQ(gate.admit(2), SeedGate::Admission::kSuperseded);
  wire::SeedVerdict verdict;
  verdict.command = {kSession, 3};
  verdict.reason = "no parallax";
  EXPECT_TRUE(gate.decide(verdict));
  EXPECT_EQ(gate.admit(3), SeedGate::Admission::kRepeated);
  EXPECT_EQ(gate.verdict().reason, "no parallax");
  EXPECT_EQ(gate.admit(4), SeedGate::Admission::kNew);
  EXPECT_FALSE(gate.decide(verdict)) << "of a seed that has been superseded";
}

constexpr wire::PublicationHandle kFirst{100};
constexpr wire::PublicationHandle kSecond{200};

TEST(Presence, ASecondLiveProcessUnderOneNameIsAnIntruder) {
  Presence presence;
  MonotonicTime now{};
  EXPECT_EQ(presence.heard("anna", kSession, kFirst, now), Presence::Standing::kNewHolder);
  EXPECT_EQ(presence.heard("anna", kSession, kFirst, now), Presence::Standing::kHolder);
  EXPECT_EQ(presence.heard("anna", SessionId{43}, kSecond, now), Presence::Standing::kIntruder);
  EXPECT_EQ(presence.heard("bob", SessionId{43}, kSecond, now), Presence::Standing::kNewHolder);
  EXPECT_TRUE(presence.holds("anna", kSession));
  EXPECT_FALSE(presence.holds("anna", SessionId{43}));
  EXPECT_FALSE(presence.holds("carl", kSession));
  EXPECT_EQ(presence.live_count(now), 2);
}

TEST(Presence, TheSameProcessMayMatchAnewOrBeginAnotherSession) {
  Presence presence;
  MonotonicTime now{};
  (void)presence.heard("anna", kSession, kFirst, now);
  EXPECT_EQ(presence.heard("anna", kSession, kSecond, now), Presence::Standing::kHolder);
  EXPECT_EQ(presence.heard("anna", SessionId{43}, kSecond, now), Presence::Standing::kNewHolder);
  EXPECT_TRUE(presence.holds("anna", SessionId{43}));
}

TEST(Presence, WhatTheHolderSaysIsToldByItsPublication) {
  Presence presence;
  MonotonicTime now{};
  EXPECT_FALSE(presence.is_holder("anna", kFirst));
  (void)presence.heard("anna", kSession, kFirst, now);
  (void)presence.heard("anna", SessionId{43}, kSecond, now);
  EXPECT_TRUE(presence.is_holder("anna", kFirst));
  EXPECT_FALSE(presence.is_holder("anna", kSecond));
  EXPECT_FALSE(presence.is_holder("bob", kFirst));
}

TEST(Presence, TheNameIsFreeWhenItsHolderIsSilentOrGone) {
  Presence presence;
  MonotonicTime now{};
  (void)presence.heard("anna", kSession, kFirst, now);
  now += Presence::kSilence - std::chrono::milliseconds(1);
  EXPECT_EQ(presence.heard("anna", SessionId{43}, kSecond, now), Presence::Standing::kIntruder)
      << "and an intruder does not keep the name alive";
  now += std::chrono::milliseconds(1);
  EXPECT_EQ(presence.live_count(now), 0);
  EXPECT_EQ(presence.heard("anna", SessionId{43}, kSecond, now), Presence::Standing::kNewHolder);
  presence.gone("anna");
  EXPECT_EQ(presence.heard("anna", SessionId{44}, kFirst, now), Presence::Standing::kNewHolder);
}

}  // namespace
}  // namespace cairn
