// SPDX-License-Identifier: Apache-2.0
#include "client/session/session_core.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/geometry/camera_guess.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

const ServerId kServer{{1}};
const ServerId kOther{{2}};
const MapId kDesk{{7}};
const MapId kBench{{8}};
constexpr SessionCore::Readers kAll{true, true, true, true};

CameraParameters parameters() {
  return {CameraModel::kPinholeRadtan, 640, 480, {500, 500, 320, 240, 0, 0, 0, 0, 0}};
}

/// A session whose server says what a test makes up.
class SessionCoreTest : public ::testing::Test {
 protected:
  explicit SessionCoreTest(SessionOptions options = {}) {
    options.name = "tracker";
    core_.emplace(std::move(options), *make_camera(parameters()), [this] { return SessionId{++sessions_}; });
  }

  void connect(ServerId server = kServer, uint64_t start = 1) {
    core_->take(wire::ServerStatus{server, start, "", "", 0, 0, 0});
    core_->take_presence(true);
  }
  void list(MapId map, const std::string& name, ServerId server = kServer) {
    wire::MapInfo info;
    info.map = map;
    info.name = name;
    info.server = server;
    core_->take(info);
  }
  void use(MapId map, uint64_t revision) {
    core_->use_map(map, {}, {});
    ASSERT_TRUE(core_->take(snapshot_of(map, revision)));
  }
  static MapSnapshotPtr snapshot_of(MapId map, uint64_t revision) {
    MapSnapshot made;
    made.map = map;
    made.epoch = Epoch{1};
    made.revision = Revision{revision};
    return std::make_shared<const MapSnapshot>(std::move(made));
  }
  void offer(uint64_t number, uint64_t reference = 0) {
    KeyframeProposal proposal;
    proposal.map = core_->maps().in_use();
    proposal.number = number;
    proposal.reference_number = reference;
    core_->send_offer({std::move(proposal), nullptr, Timestamp{}});
  }
  /// All that is to be sent now; a camera can be written.
  std::vector<SessionCore::Outgoing> drain(SessionCore::Readers readers = kAll) {
    std::vector<SessionCore::Outgoing> all;
    while (auto next = core_->next(now_, readers)) {
      if (std::holds_alternative<wire::CameraMessage>(*next)) core_->written(true);
      all.push_back(std::move(*next));
    }
    return all;
  }
  template <typename Kind>
  static std::vector<Kind> only(const std::vector<SessionCore::Outgoing>& all) {
    std::vector<Kind> found;
    for (const auto& one : all) {
      if (const Kind* kind = std::get_if<Kind>(&one)) found.push_back(*kind);
    }
    return found;
  }
  void decide(uint64_t last, uint32_t credit, std::vector<wire::OfferOutcome> recent = {}) {
    core_->take(wire::OfferVerdict{core_->client(), SessionId{sessions_}, last, credit, std::move(recent)});
  }

  uint64_t sessions_ = 0;
  MonotonicTime now_{std::chrono::seconds(1)};
  std::optional<SessionCore> core_;
};

TEST_F(SessionCoreTest, TheCameraGoesOutBeforeAnyCommandThatNamesIt) {
  connect();
  use(kDesk, 1);
  offer(1);
  const auto first = core_->next(now_, kAll);
  ASSERT_TRUE(first && std::holds_alternative<wire::CameraMessage>(*first));
  for (const auto& next : drain()) {
    EXPECT_FALSE(std::holds_alternative<SessionCore::Offer>(next)) << "it has not been written yet";
  }
  core_->written(true);
  EXPECT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
}

TEST_F(SessionCoreTest, ACameraThatCannotBeWrittenIsTriedAgainWithTheNextStateAndNotAtOnce) {
  connect();
  ASSERT_TRUE(core_->next(now_, kAll));
  core_->written(false);
  const auto state = core_->next(now_, kAll);
  ASSERT_TRUE(state && std::holds_alternative<wire::TrackerStateMessage>(*state));
  const auto again = core_->next(now_, kAll);
  ASSERT_TRUE(again && std::holds_alternative<wire::CameraMessage>(*again));
  core_->written(false);
  EXPECT_FALSE(core_->next(now_, kAll));
  now_ = core_->next_due();
  EXPECT_EQ(only<wire::CameraMessage>(drain()).size(), 1U);
}

TEST_F(SessionCoreTest, TheStateGoesOutAtMostSixtyTimesASecondAndAtLeastFive) {
  size_t sent = 0;
  for (const auto end = now_ + std::chrono::seconds(10); now_ < end; now_ += milliseconds(1)) {
    core_->publish_state({}, {});
    sent += only<wire::TrackerStateMessage>(drain()).size();
  }
  EXPECT_GE(sent, 600U);
  EXPECT_LE(sent, 626U);
  (void)drain();
  sent = 0;
  for (const auto end = now_ + std::chrono::seconds(10); now_ < end; now_ += milliseconds(1))
    sent += only<wire::TrackerStateMessage>(drain()).size();
  EXPECT_GE(sent, 49U);
  EXPECT_LE(sent, 51U);
}

TEST_F(SessionCoreTest, AnOfferNamesTheCommandOfTheOneItIsRelativeTo) {
  connect();
  use(kDesk, 1);
  decide(0, 4);
  offer(11);
  offer(12, 11);
  offer(13, 99);
  const auto sent = only<SessionCore::Offer>(drain());
  ASSERT_EQ(sent.size(), 3U);
  EXPECT_EQ(sent[0].reference, 0U);
  EXPECT_EQ(sent[1].reference, sent[0].sendable.command.seq);
  EXPECT_EQ(sent[2].reference, 0U) << "it is not known";
}

TEST_F(SessionCoreTest, NothingIsSentThatTheServerDoesNotRead) {
  connect();
  use(kDesk, 1);
  offer(1);
  EXPECT_TRUE(only<SessionCore::Offer>(drain({true, true, false, true})).empty());
  EXPECT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
}

TEST_F(SessionCoreTest, AMapIsWaitedForOnlyWhileItsServerIsThereAndHasIt) {
  connect();
  EXPECT_FALSE(core_->status().waits_for_map);
  list(kDesk, "desk");
  core_->use_map(kDesk, {}, {});
  EXPECT_TRUE(core_->status().waits_for_map);
  core_->take_presence(false);
  EXPECT_FALSE(core_->status().waits_for_map) << "nobody sends it";
  connect();
  EXPECT_TRUE(core_->status().waits_for_map);
  core_->take_unlisted(kDesk);
  EXPECT_FALSE(core_->status().waits_for_map) << "it is gone";
  list(kDesk, "desk");
  ASSERT_TRUE(core_->take(snapshot_of(kDesk, 1)));
  EXPECT_FALSE(core_->status().waits_for_map) << "it is there";
}

TEST_F(SessionCoreTest, AServerThatKnowsNothingOfUsGetsANewSessionAndOffersAreGivenUp) {
  connect();
  list(kDesk, "desk");
  use(kDesk, 1);
  offer(1);
  core_->send_seed({});
  (void)drain();
  (void)core_->take_actions();
  connect(kOther);
  EXPECT_EQ(sessions_, 2U);
  const auto replies = core_->take_offer_replies();
  ASSERT_EQ(replies.size(), 1U);
  EXPECT_FALSE(replies.front().accepted);
  EXPECT_EQ(replies.front().number, 1U) << "the tracker waits for it";
  EXPECT_EQ(core_->status().link, ServerLink::kRestarted);
  EXPECT_EQ(core_->maps().snapshot()->map, kDesk) << "the replica stays";
  const auto seeds = only<SeedSlot::Sendable>(drain());
  ASSERT_EQ(seeds.size(), 1U) << "a seed needs no map";
  EXPECT_EQ(seeds.front().command.session, SessionId{2});
  const auto actions = core_->take_actions();
  EXPECT_TRUE(actions.look_what_changed);
  ASSERT_EQ(actions.notices.size(), 1U);
  EXPECT_THAT(actions.notices.front().text, HasSubstr("started anew"));
  offer(2);
  EXPECT_EQ(core_->take_offer_replies().size(), 1U) << "its map is known no more";
}

TEST_F(SessionCoreTest, AServerThatHasKeptItsMapsGetsWhatIsUndecidedAgainAtOnce) {
  connect();
  list(kDesk, "desk");
  use(kDesk, 1);
  offer(1);
  ASSERT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
  core_->take_presence(false);
  EXPECT_THAT(core_->status().text, HasSubstr("tracking on the replica"));
  EXPECT_TRUE(only<SessionCore::Offer>(drain()).empty()) << "nobody is there";
  connect(kServer, 2);
  EXPECT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
  EXPECT_EQ(sessions_, 1U);
}

TEST_F(SessionCoreTest, WhoIsRefusedIsToldWhyAndSendsAgainWhenThatIsOver) {
  connect();
  use(kDesk, 1);
  decide(0, 2);
  offer(1);
  ASSERT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
  wire::OfferOutcome notice;
  notice.reason = "another process has this name";
  decide(0, 2, {notice});
  EXPECT_EQ(core_->status().link, ServerLink::kRefused);
  EXPECT_EQ(core_->status().text, notice.reason);
  EXPECT_FALSE(core_->is_name_held());
  decide(0, 2);
  EXPECT_TRUE(core_->is_name_held());
  EXPECT_EQ(only<SessionCore::Offer>(drain()).size(), 1U);
}

TEST_F(SessionCoreTest, WhatTheServerSaidLastOfARefusalHoldsWhenItIsNotHeardAnyMore) {
  wire::OfferOutcome notice;
  notice.reason = "keys revoked";
  decide(0, 0, {notice});
  EXPECT_EQ(core_->status().link, ServerLink::kRefused) << "the server has said nothing else yet";
  EXPECT_EQ(core_->status().text, "keys revoked");
  connect();
  use(kDesk, 1);
  core_->take_presence(false);
  EXPECT_EQ(core_->status().link, ServerLink::kRefused);
  EXPECT_THAT(core_->status().text, HasSubstr("keys revoked; the server is not heard"));
  connect();
  decide(0, 2);
  EXPECT_EQ(core_->status().link, ServerLink::kConnected);
}

class SecuredCoreTest : public SessionCoreTest {
 protected:
  static SessionOptions secured() {
    SessionOptions options;
    options.security = "keys";
    return options;
  }
  SecuredCoreTest() : SessionCoreTest(secured()) {}
};

TEST_F(SecuredCoreTest, AServerThatIsGoneMayBeOneThatDoesNotAcceptOurKeys) {
  connect();
  core_->take_presence(false);
  EXPECT_THAT(core_->status().text, HasSubstr("no longer accepts our keys"));
}

TEST_F(SessionCoreTest, IsSettledWhenAllIsDecidedAndTheNamedRevisionIsThere) {
  connect();
  use(kDesk, 1);
  EXPECT_TRUE(core_->is_settled());
  offer(1);
  EXPECT_FALSE(core_->is_settled());
  (void)drain();
  wire::OfferOutcome accepted;
  accepted.seq = 1;
  accepted.map = kDesk;
  accepted.epoch = Epoch{1};
  accepted.revision = Revision{2};
  decide(1, 2, {accepted});
  EXPECT_FALSE(core_->is_settled()) << "the revision has not come";
  ASSERT_TRUE(core_->take(snapshot_of(kDesk, 2)));
  EXPECT_TRUE(core_->is_settled());
}

TEST_F(SessionCoreTest, LeavingAMapForgetsWhatWasUnderWayAndItsAnswers) {
  connect();
  use(kDesk, 1);
  core_->send_seed({});
  core_->send_query(std::make_shared<const PlaceView>(), {});
  core_->leave_map();
  EXPECT_TRUE(core_->is_settled());
  EXPECT_EQ(core_->maps().snapshot(), nullptr);
  const auto sent = drain();
  EXPECT_TRUE(only<SeedSlot::Sendable>(sent).empty() && only<QuerySlot::Sendable>(sent).empty());
}

TEST_F(SessionCoreTest, AMapThatWasInUseOfLateIsThereAtOnce) {
  connect();
  use(kDesk, 1);
  use(kBench, 1);
  ASSERT_TRUE(core_->take(snapshot_of(kDesk, 5))) << "it goes on being received";
  EXPECT_EQ(core_->maps().snapshot()->map, kBench);
  core_->use_map(kDesk, {}, {});
  EXPECT_EQ(core_->maps().snapshot()->revision, Revision{5});
}

/// A tracker that was told its map by name.
class BoundCoreTest : public SessionCoreTest {
 protected:
  static SessionOptions bound() {
    SessionOptions options;
    options.only_map = "desk";
    return options;
  }
  BoundCoreTest() : SessionCoreTest(bound()) {}
};

TEST_F(BoundCoreTest, UsesTheMapOfItsNameAndHearsOfNoOther) {
  list(kBench, "bench");
  connect();
  EXPECT_EQ(core_->maps().in_use(), MapId{});
  list(kDesk, "desk");
  core_->take_presence(true);
  EXPECT_EQ(core_->maps().in_use(), kDesk);
  core_->send_query(std::make_shared<const PlaceView>(), {});
  const auto sent = only<QuerySlot::Sendable>(drain());
  ASSERT_EQ(sent.size(), 1U);
  wire::RelocAnswer answer;
  answer.command = sent.front().command;
  answer.answer.verdict = RelocalizationVerdict::kConfirmed;
  answer.answer.candidates.resize(1);
  answer.answer.candidates.front().map = kBench;
  core_->take(answer);
  const auto place = core_->take_relocalization_answer();
  ASSERT_TRUE(place);
  EXPECT_EQ(place->verdict, RelocalizationVerdict::kNotKnown);
  EXPECT_TRUE(place->candidates.empty());
}

/// A reader of maps.
class ReaderCoreTest : public SessionCoreTest {
 protected:
  static SessionOptions reading() {
    SessionOptions options;
    options.reads_only = true;
    return options;
  }
  ReaderCoreTest() : SessionCoreTest(reading()) {}
};

TEST_F(ReaderCoreTest, ChangesNoLabels) {
  connect();
  use(kDesk, 1);
  core_->send_request({});
  const auto replies = core_->take_request_replies();
  ASSERT_EQ(replies.size(), 1U);
  EXPECT_FALSE(replies.front().done);
  EXPECT_TRUE(only<RequestSpool::Sendable>(drain()).empty());
}

TEST_F(ReaderCoreTest, OffersKeyframesOnlyWhereTheMapTakesProposalsAndSaysSoOnce) {
  connect();
  EXPECT_EQ(core_->keyframe_use(kDesk), KeyframeUse::kNothing);
  wire::MapInfo info;
  info.map = kDesk;
  info.server = kServer;
  info.right = wire::MapRight::kRead;
  info.takes_proposals = true;
  core_->take(info);
  EXPECT_EQ(core_->keyframe_use(kDesk), KeyframeUse::kProposal);
  use(kDesk, 1);
  decide(0, 4);
  (void)core_->take_actions();
  offer(1);
  offer(2);
  EXPECT_EQ(only<SessionCore::Offer>(drain()).size(), 2U);
  EXPECT_EQ(core_->take_actions().notices.size(), 1U);
  core_->take_unlisted(kDesk);
  EXPECT_EQ(core_->keyframe_use(kDesk), KeyframeUse::kNothing);
}

}  // namespace
}  // namespace cairn
