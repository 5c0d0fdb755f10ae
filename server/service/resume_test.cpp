// SPDX-License-Identifier: Apache-2.0
#include "server/service/resume.h"

#include <gtest/gtest.h>

#include <string>

#include "common/base/utf8.h"
#include "server/service/command_gate.h"

namespace cairn {
namespace {

constexpr SessionId kSession{42};

DecisionRecord decision(const std::string& client, uint64_t seq, int64_t time) {
  DecisionRecord made;
  made.client = client;
  made.session = kSession;
  made.seq = seq;
  made.time = {time};
  return made;
}

/// A server keeps so many names, and its clients of before the restart are not back yet.
TEST(ResumeClients, OfMoreThanAreRememberedTheOnesLastDecidedOnAreKnown) {
  constexpr size_t kMost = 256;
  std::vector<DecisionRecord> old;
  for (int i = 0; i < 400; ++i) old.push_back(decision("z-" + std::to_string(i), 1, 1000 + i));
  const std::vector<DecisionRecord> recent{decision("a", 7, 3000), decision("b", 8, 2000)};
  const KeptDecisions maps[] = {{MapId{{1}}, Epoch{9}, recent}, {MapId{{2}}, Epoch{9}, old}};
  const auto clients = resume_clients(maps, kMost);
  ASSERT_EQ(clients.size(), kMost);
  EXPECT_EQ(clients.back().first, "a");
  EXPECT_EQ(clients[kMost - 2].first, "b");
  EXPECT_EQ(clients[kMost - 3].first, "z-399");
  EXPECT_EQ(clients.front().first, "z-146") << "the rest, the latest at the end";
  ASSERT_EQ(clients.back().second.offers.size(), 1U);
  OfferGate gate;
  gate.resume(clients.back().second.session, clients.back().second.offers);
  EXPECT_EQ(gate.admit(7), OfferGate::Admission::kRepeated) << "it would be applied twice";
}

TEST(ResumeClients, WhatCountsIsTheLastOfAllMapsAndOfTheNewestSession) {
  DecisionRecord before = decision("anna", 5, 10);
  before.session = SessionId{41};
  const std::vector<DecisionRecord> first{before, decision("anna", 2, 30), decision("bob", 1, 20)};
  const std::vector<DecisionRecord> second{decision("bob", 3, 40), decision("anna", 1, 25)};
  const KeptDecisions maps[] = {{MapId{{1}}, Epoch{9}, first}, {MapId{{2}}, Epoch{9}, second}};
  const auto clients = resume_clients(maps, 1);
  ASSERT_EQ(clients.size(), 1U);
  EXPECT_EQ(clients[0].first, "bob");
  const auto both = resume_clients(maps, 2);
  ASSERT_EQ(both.size(), 2U);
  EXPECT_EQ(both[0].second.session, kSession);
  ASSERT_EQ(both[0].second.offers.size(), 2U);
  EXPECT_EQ(both[0].second.offers[0].seq, 1U);
  EXPECT_EQ(both[0].second.offers[1].seq, 2U);
}

TEST(ResumeClients, AProposalThatWasAcceptedIsAnsweredAsAccepted) {
  DecisionRecord kept = decision("anna", 2, 20);
  kept.decision = static_cast<uint8_t>(wire::OfferDecision::kKeptAside);
  DecisionRecord accepted = decision("anna", 2, 20);
  accepted.keyframe = KeyframeId{9};
  const std::vector<DecisionRecord> decisions{decision("anna", 1, 10), kept, decision("anna", 3, 30),
                                              accepted};
  const KeptDecisions maps[] = {{MapId{{1}}, Epoch{9}, decisions}};
  const auto clients = resume_clients(maps, 1);
  ASSERT_EQ(clients.size(), 1U);
  const auto& offers = clients[0].second.offers;
  ASSERT_EQ(offers.size(), 3U);
  EXPECT_EQ(offers[1].seq, 2U);
  EXPECT_EQ(offers[1].decision, wire::OfferDecision::kAccepted);
  EXPECT_EQ(offers[1].keyframe, (KeyframeId{9}));
}

TEST(ResumeClients, ADecisionThatNoServerMakesIsAnsweredAsOneThatClientsTake) {
  DecisionRecord offer = decision("anna", 1, 10);
  offer.kind = CommandKind::kOffer;
  offer.decision = 200;
  offer.reason = std::string(2 * wire::kMaxReasonBytes, 'x') + "\x1b[2J";
  DecisionRecord request = offer;
  request.kind = CommandKind::kRequest;
  const std::vector<DecisionRecord> decisions{offer, request};
  const KeptDecisions maps[] = {{MapId{{1}}, Epoch{9}, decisions}};
  const auto clients = resume_clients(maps, 1);
  ASSERT_EQ(clients.size(), 1U);
  const ResumedClient& anna = clients[0].second;
  ASSERT_EQ(anna.offers.size(), 1U);
  ASSERT_EQ(anna.requests.size(), 1U);
  EXPECT_EQ(anna.offers[0].decision, wire::OfferDecision::kDamaged);
  EXPECT_EQ(anna.requests[0].decision, wire::RequestDecision::kUnfit);
  for (const std::string& reason : {anna.offers[0].reason, anna.requests[0].reason}) {
    EXPECT_LE(reason.size(), wire::kMaxReasonBytes);
    EXPECT_FALSE(fault_of_text(reason)) << reason;
  }
}

/// An id that a later roll-back has given up means another keyframe now, whatever the epochs between began
/// with.
TEST(CarryOver, WhatAnyLaterEpochHasGivenUpIsGone) {
  const EpochRecord epochs[] = {
      {Epoch{1}, 0, 0}, {Epoch{2}, 20, 900}, {Epoch{3}, 15, 700}, {Epoch{4}, 30, 1200}};
  const auto carried = [&](uint64_t tracked_in, uint64_t reference, KeyframeInput frame = {}) {
    frame.reference = KeyframeId{reference};
    return carry_over(epochs, Epoch{tracked_in}, Epoch{4}, &frame);
  };
  EXPECT_TRUE(carried(1, 15));
  EXPECT_FALSE(carried(1, 18));
  EXPECT_FALSE(carried(2, 18));
  EXPECT_TRUE(carried(3, 18));
  EXPECT_FALSE(carried(9, 1)) << "an epoch that never was";
  KeyframeInput frame;
  frame.reference = KeyframeId{3};
  frame.measurements = {{PointId{650}, 0, {}}, {PointId{800}, 0, {}}};
  ASSERT_TRUE(carry_over(epochs, Epoch{1}, Epoch{4}, &frame));
  ASSERT_EQ(frame.measurements.size(), 1U);
  EXPECT_EQ(frame.measurements[0].id, PointId{650});
}

}  // namespace
}  // namespace cairn
