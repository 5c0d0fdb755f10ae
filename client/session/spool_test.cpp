// SPDX-License-Identifier: Apache-2.0
#include "client/session/spool.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using wire::OfferDecision;

constexpr SessionId kSession{77};

SpooledOffer offer_at(int64_t nanoseconds) {
  return {{}, nullptr, Timestamp{nanoseconds}};
}

wire::OfferVerdict verdict(uint64_t last_decided, uint32_t credit,
                           std::vector<wire::OfferOutcome> recent = {}) {
  return {{}, kSession, last_decided, credit, std::move(recent)};
}

wire::OfferOutcome outcome(uint64_t seq, OfferDecision decision, std::string reason = {}) {
  wire::OfferOutcome made;
  made.seq = seq;
  made.decision = decision;
  made.reason = std::move(reason);
  return made;
}

/// All that may leave now.
std::vector<uint64_t> drain(Spool* spool, MonotonicTime now) {
  std::vector<uint64_t> sent;
  while (const auto sendable = spool->next(now)) {
    EXPECT_EQ(sendable->command.session, spool->session());
    sent.push_back(sendable->command.seq);
  }
  return sent;
}

TEST(Spool, SendsInOrderWithinTheCreditOnly) {
  Spool spool(32, kSession);
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(spool.push(offer_at(i)));
  MonotonicTime now{};
  EXPECT_EQ(drain(&spool, now), (std::vector<uint64_t>{1})) << "one until the server has said more";
  EXPECT_TRUE(spool.apply(verdict(0, 3)).empty());
  EXPECT_EQ(drain(&spool, now), (std::vector<uint64_t>{2, 3}));
  EXPECT_EQ(spool.apply(verdict(2, 3)).size(), 2U);
  EXPECT_EQ(drain(&spool, now), (std::vector<uint64_t>{4, 5}));
  EXPECT_EQ(spool.size(), 8U);
}

TEST(Spool, OfARequestItSaysWhichLabelItWas) {
  RequestSpool spool(2, kSession);
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(spool.push({}));
  const auto lost = spool.push({});
  ASSERT_TRUE(lost.has_value());
  EXPECT_FALSE(lost->done);
  EXPECT_FALSE(lost->reason.empty());
  wire::ClientReply reply{{}, kSession, 0, 2, {}};
  (void)spool.apply(reply);
  while (spool.next({})) {
  }
  reply.last_decided = 2;
  reply.recent = {{1, wire::RequestDecision::kDone, "", MapId{{1}}, LabelId{7}},
                  {2, wire::RequestDecision::kUnknownLabel, "there is no such label", MapId{{1}}, {}}};
  const auto replies = spool.apply(reply);
  ASSERT_EQ(replies.size(), 2U);
  EXPECT_TRUE(replies[0].done);
  EXPECT_EQ(replies[0].label, LabelId{7});
  EXPECT_FALSE(replies[1].done);
  EXPECT_EQ(replies[1].reason, "there is no such label");
}

TEST(Spool, ReportsEachDecisionOnceWithItsReason) {
  Spool spool(32, kSession);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(spool.push(offer_at(i)));
  (void)spool.apply(verdict(0, 8));
  (void)drain(&spool, {});
  const auto decided =
      verdict(2, 8, {outcome(1, OfferDecision::kAccepted), outcome(2, OfferDecision::kTooClose, "near")});
  const auto replies = spool.apply(decided);
  ASSERT_EQ(replies.size(), 2U);
  EXPECT_TRUE(replies[0].accepted);
  EXPECT_EQ(replies[0].seq, 1U);
  EXPECT_FALSE(replies[1].accepted);
  EXPECT_EQ(replies[1].reason, "near");
  EXPECT_TRUE(spool.apply(decided).empty()) << "a verdict sent again decides nothing again";
  EXPECT_EQ(spool.size(), 1U);
}

TEST(Spool, AVerdictForAnotherSessionOrTheFutureDecidesNothing) {
  Spool spool(32, kSession);
  EXPECT_FALSE(spool.push(offer_at(1)));
  (void)drain(&spool, {});
  wire::OfferVerdict other = verdict(1, 8);
  other.session = SessionId{78};
  EXPECT_TRUE(spool.apply(other).empty());
  EXPECT_EQ(spool.apply(verdict(1000, 8)).size(), 1U);
  EXPECT_FALSE(spool.push(offer_at(2)));
  EXPECT_EQ(drain(&spool, {}), (std::vector<uint64_t>{2})) << "what was never sent cannot have been decided";
  EXPECT_EQ(spool.size(), 1U);
}

TEST(Spool, SendsAgainTheSameOfferWithTheSameNumberUntilDecided) {
  Spool spool(32, kSession);
  EXPECT_FALSE(spool.push(offer_at(41)));
  MonotonicTime now{};
  const auto first = spool.next(now);
  ASSERT_TRUE(first.has_value());
  EXPECT_FALSE(spool.next(now + kFirstResend - milliseconds(1)));
  const auto again = spool.next(now + kFirstResend);
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->command, first->command);
  EXPECT_EQ(again->item, first->item);
  EXPECT_FALSE(spool.next(now + kFirstResend + 2 * kFirstResend - milliseconds(1)))
      << "then after twice as long";
  spool.resend_all();
  EXPECT_TRUE(spool.next(now + kFirstResend).has_value()) << "at once after a new match";
  (void)spool.apply(verdict(1, 4));
  spool.resend_all();
  EXPECT_FALSE(spool.next(now + std::chrono::hours(1))) << "never after the decision";
}

/// The tracker waits for each answer by the number of its proposal, whatever became of the offer.
TEST(Spool, EveryReplyNamesTheProposal) {
  Spool spool(2, kSession);
  for (uint64_t number = 11; number <= 13; ++number) {
    SpooledOffer offer = offer_at(1);
    offer.proposal.number = number;
    const auto lost = spool.push(std::move(offer));
    if (number == 13) {
      ASSERT_TRUE(lost.has_value());
      EXPECT_EQ(lost->number, 11U);
    }
  }
  (void)spool.apply(verdict(0, 2));
  (void)drain(&spool, {});
  const auto decided = spool.apply(verdict(1, 2));
  ASSERT_EQ(decided.size(), 1U);
  EXPECT_EQ(decided[0].number, 12U) << "also when the reason was missed";
  const auto lost = spool.restart(SessionId{1}, "gone");
  ASSERT_EQ(lost.size(), 1U);
  EXPECT_EQ(lost[0].number, 13U);
}

TEST(Spool, WhenFullTheOldestUnsentGoes) {
  Spool spool(3, kSession);
  for (int i = 1; i <= 3; ++i) EXPECT_FALSE(spool.push(offer_at(i)));
  ASSERT_TRUE(spool.next({}).has_value());  // offer 1 is under way
  const auto lost = spool.push(offer_at(4));
  ASSERT_TRUE(lost.has_value());
  EXPECT_FALSE(lost->accepted);
  EXPECT_EQ(spool.size(), 3U);
  (void)spool.apply(verdict(1, 8));
  const auto next = spool.next({});
  ASSERT_TRUE(next.has_value());
  EXPECT_EQ(next->item->time, Timestamp{3}) << "offer 2 was dropped";
  EXPECT_EQ(next->command.seq, 2U) << "numbers have no gaps";
}

TEST(Spool, WhenAllAreUnderWayTheNewOneGoes) {
  Spool spool(2, kSession);
  (void)spool.apply(verdict(0, 8));
  for (int i = 1; i <= 2; ++i) EXPECT_FALSE(spool.push(offer_at(i)));
  (void)drain(&spool, {});
  EXPECT_TRUE(spool.push(offer_at(3)).has_value());
  EXPECT_EQ(spool.size(), 2U);
}

TEST(Spool, AnotherServerLosesTheOffersAndCountsAnew) {
  Spool spool(8, kSession);
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(spool.push(offer_at(i)));
  (void)drain(&spool, {});
  const auto lost = spool.restart(SessionId{78}, "gone");
  ASSERT_EQ(lost.size(), 3U);
  EXPECT_EQ(lost[2].reason, "gone");
  EXPECT_EQ(spool.size(), 0U);
  EXPECT_FALSE(spool.push(offer_at(9)));
  EXPECT_EQ(drain(&spool, {}), (std::vector<uint64_t>{1}));
}

TEST(SeedSlot, SendsUntilTheVerdictOnThisVerySeed) {
  SeedSlot slot(kSession);
  EXPECT_FALSE(slot.next({}));
  slot.put({});
  const auto sent = slot.next({});
  ASSERT_TRUE(sent.has_value());
  EXPECT_FALSE(slot.next({}));
  EXPECT_EQ(slot.next(MonotonicTime{} + kFirstResend)->command, sent->command);
  wire::SeedVerdict verdict;
  verdict.command = {kSession, sent->command.seq + 1};
  EXPECT_FALSE(slot.apply(verdict));
  verdict.command = {SessionId{1}, sent->command.seq};
  EXPECT_FALSE(slot.apply(verdict));
  verdict.command = sent->command;
  EXPECT_TRUE(slot.apply(verdict));
  EXPECT_TRUE(slot.empty());
  EXPECT_FALSE(slot.apply(verdict));
}

TEST(SeedSlot, ANewerSeedSupersedesAndAnotherServerGetsItToo) {
  SeedSlot slot(kSession);
  slot.put({});
  const auto first = slot.next({});
  slot.put({});
  const auto second = slot.next({});
  ASSERT_TRUE(first && second);
  EXPECT_GT(second->command.seq, first->command.seq);
  slot.restart(SessionId{78});
  const auto again = slot.next({});
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(again->item, second->item);
  EXPECT_EQ(again->command.session, SessionId{78});
}

wire::RelocAnswer answer_to(const QuerySlot::Sendable& sent) {
  wire::RelocAnswer answer;
  answer.command = sent.command;
  return answer;
}

TEST(QuerySlot, OneQueryIsUnderWayAndOnlyItsAnswerCounts) {
  QuerySlot slot(SessionId{5});
  const MonotonicTime now{};
  EXPECT_FALSE(slot.next(now));
  slot.put({});
  const auto first = slot.next(now);
  ASSERT_TRUE(first);
  EXPECT_FALSE(slot.next(now)) << "sent";
  EXPECT_TRUE(slot.next(now + kFirstResend)) << "sent again: it may have been lost";
  slot.put({});
  const auto second = slot.next(now);
  ASSERT_TRUE(second);
  EXPECT_FALSE(slot.apply(answer_to(*first))) << "superseded";
  EXPECT_FALSE(slot.empty());
  EXPECT_TRUE(slot.apply(answer_to(*second)));
  EXPECT_TRUE(slot.empty());
  EXPECT_FALSE(slot.apply(answer_to(*second))) << "twice";
}

TEST(QuerySlot, ADroppedServerAnswersNothing) {
  QuerySlot slot(SessionId{5});
  slot.put({});
  const auto sent = slot.next(MonotonicTime{});
  ASSERT_TRUE(sent);
  slot.drop();
  slot.restart(SessionId{6});
  EXPECT_TRUE(slot.empty());
  EXPECT_FALSE(slot.apply(answer_to(*sent)));
  slot.put({});
  EXPECT_EQ(slot.next(MonotonicTime{})->command.session, SessionId{6});
}

}  // namespace
}  // namespace cairn
