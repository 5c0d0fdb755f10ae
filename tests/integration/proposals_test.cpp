// SPDX-License-Identifier: Apache-2.0
// Keyframes of those who may not add them: kept aside where that is welcome, and part of the map once an
// operator has accepted them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/io/image_file.h"
#include "server/admin/admin_client.h"
#include "tests/integration/label_fixture.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using ::testing::Contains;
using testing::eventually;
using ::testing::HasSubstr;

class ProposalsTest : public testing::LabelFixture {
 protected:
  ProposalsTest() {
    service_options_.proposals.interval = 0ms;
    service_.reset();
    start_service_again();
    connect();
  }
  void connect() {
    AdminClientOptions connection;
    connection.domain = service_options_.domain;
    auto admin = AdminClient::connect(connection);
    if (!admin) throw std::runtime_error(admin.error().message);
    admin_.emplace(std::move(*admin));
  }
  json done(const json& request) {
    const auto answer = admin_->ask(request);
    EXPECT_TRUE(answer) << request.dump() << ": " << answer.error().message;
    return answer ? answer->content : json::object();
  }
  /// Why not.
  std::string refused(const json& request) {
    const auto answer = admin_->ask(request);
    EXPECT_FALSE(answer) << request.dump();
    return answer ? std::string() : answer.error().message;
  }
  void welcome(bool yes) { done({{"verb", "proposals-welcome"}, {"map", "map-1"}, {"welcome", yes}}); }
  [[nodiscard]] json proposals() { return done({{"verb", "proposals"}})["proposals"]; }
  [[nodiscard]] static json about(const char* verb, const std::string& id) {
    return {{"verb", verb}, {"proposal", id}};
  }
  std::unique_ptr<Session> open_reader(const std::string& name) {
    auto session = open(name, true);
    session->use_map(map_);
    EXPECT_TRUE(session->wait_for_map(60s));
    return session;
  }
  /// `tracked_in`: the replica; `reference`: another keyframe than the second.
  OfferReply offer(Session& session, const MapSnapshot& tracked_in, int step, KeyframeId reference = {}) {
    testing::Frame frame = testing::make_offer(scene_, tracked_in, step);
    if (reference) {
      const SE3 pose =
          frame.proposal.camera_from_reference * tracked_in.find(frame.proposal.reference)->camera_from_map;
      frame.proposal.reference = reference;
      frame.proposal.camera_from_reference = pose * tracked_in.find(reference)->camera_from_map.inverse();
    }
    session.send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
    std::vector<OfferReply> replies;
    EXPECT_TRUE(eventually([&] { return !(replies = session.take_offer_replies()).empty(); }));
    return replies.size() == 1 ? replies.front() : OfferReply{};
  }
  /// The id of what has been kept aside.
  std::string propose(Session& session, int step) {
    const OfferReply reply = offer(session, *session.snapshot(), step);
    EXPECT_FALSE(reply.accepted);
    EXPECT_TRUE(reply.kept_aside) << reply.reason;
    const json all = proposals();
    return all.empty() ? "" : all.back().value("id", "");
  }
  [[nodiscard]] size_t keyframes(const Session& session) { return session.snapshot()->keyframe_count(); }

  std::optional<AdminClient> admin_;
};

TEST_F(ProposalsTest, WhereTheyAreOffNothingOfAReaderIsKept) {
  make_map();
  const auto rita = open_reader("rita");
  EXPECT_EQ(rita->keyframe_use(map_), KeyframeUse::kNothing);
  EXPECT_EQ(anna_->keyframe_use(map_), KeyframeUse::kKeyframe);
  const OfferReply reply = offer(*rita, *rita->snapshot(), 6);
  EXPECT_FALSE(reply.accepted || reply.kept_aside);
  EXPECT_EQ(reply.reason, "no proposals are taken in this map");
  EXPECT_TRUE(proposals().empty());
  EXPECT_EQ(keyframes(*anna_), 2U);
  welcome(true);
  EXPECT_TRUE(eventually([&] { return rita->keyframe_use(map_) == KeyframeUse::kProposal; }));
  EXPECT_EQ(anna_->keyframe_use(map_), KeyframeUse::kKeyframe);
  welcome(false);
  EXPECT_TRUE(eventually([&] { return rita->keyframe_use(map_) == KeyframeUse::kNothing; }));
}

TEST_F(ProposalsTest, WhatIsAcceptedIsEverybodys) {
  make_map();
  welcome(true);
  const auto rita = open_reader("rita");
  const std::string id = propose(*rita, 6);
  EXPECT_EQ(keyframes(*anna_), 2U);
  const json listed = proposals();
  ASSERT_EQ(listed.size(), 1U);
  EXPECT_EQ(listed[0]["client"], "rita");
  EXPECT_EQ(listed[0]["map_name"], "map-1");
  EXPECT_GT(listed[0]["found"], 20);
  EXPECT_LE(listed[0]["found"], listed[0]["expected"]);
  EXPECT_THAT(offer(*rita, *rita->snapshot(), 6).reason, HasSubstr("proposal " + id + " shows the same"));

  // It is there after another start, with its encoded and what is to be seen in it.
  service_.reset();
  start_service_again();
  connect();
  EXPECT_EQ(proposals(), listed);
  const json shown = done(about("proposal-show", id));
  EXPECT_EQ(shown["points"].size(), shown["expected_now"]);
  EXPECT_GT(shown["found_now"], 20);
  const auto piece = admin_->ask(about("proposal-picture", id));
  ASSERT_TRUE(piece);
  std::vector<uint8_t> encoded = piece->data;
  while (encoded.size() < piece->content["bytes"]) {
    json more = about("proposal-picture", id);
    more["offset"] = encoded.size();
    const auto next = admin_->ask(more);
    ASSERT_TRUE(next && !next->data.empty());
    encoded.insert(encoded.end(), next->data.begin(), next->data.end());
  }
  const auto image = decode_gray_image(encoded);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->width(), scene_.camera()->width());

  const json accepted = done(about("proposal-accept", id));
  EXPECT_EQ(accepted["client"], "rita");
  EXPECT_EQ(accepted["keyframe"], 3);
  EXPECT_TRUE(eventually([&] { return keyframes(*anna_) == 3 && keyframes(*rita) == 3; }));
  EXPECT_TRUE(proposals().empty());
  EXPECT_THAT(refused(about("proposal-accept", id)), HasSubstr("no proposal " + id));
  std::vector<std::string> audit;
  const json entries = done({{"verb", "audit"}})["entries"];
  for (const auto& entry : entries)
    audit.push_back(entry["action"].get<std::string>() + ": " + entry["object"].get<std::string>());
  EXPECT_THAT(audit, Contains("proposal accept: proposal " + id));
  EXPECT_THAT(audit, Contains("proposal show: proposal " + id));

  // And after the next start it is a keyframe of the map, and no proposal.
  service_.reset();
  start_service_again();
  connect();
  EXPECT_TRUE(proposals().empty());
  EXPECT_EQ(done({{"verb", "show"}, {"map", "map-1"}})["keyframes"], 3);
}

TEST_F(ProposalsTest, AcceptedIsWhatTheMapAsItIsNowHasRoomFor) {
  make_map();
  welcome(true);
  const auto rita = open_reader("rita");
  const std::string id = propose(*rita, 6);
  ASSERT_TRUE(offer(*anna_, *anna_->snapshot(), 6).accepted) << "a builder is not held up by a proposal";
  EXPECT_THAT(refused(about("proposal-accept", id)), HasSubstr("it stays until it is dropped"));
  EXPECT_EQ(proposals().size(), 1U);
  EXPECT_EQ(done(about("proposal-drop", id))["id"], id);
  EXPECT_TRUE(proposals().empty());
}

TEST_F(ProposalsTest, AFrozenMapAndAnExtentKeepThemAsideToo) {
  make_map();
  welcome(true);
  done({{"verb", "map-freeze"}, {"map", "map-1"}, {"why", "on show"}});
  ASSERT_TRUE(eventually([&] { return anna_->keyframe_use(map_) == KeyframeUse::kProposal; }));
  const std::string id = propose(*anna_, 6);
  EXPECT_THAT(proposals()[0]["why"], HasSubstr("frozen by"));
  EXPECT_THAT(refused(about("proposal-accept", id)), HasSubstr("map map-1 unfreeze"));
  done({{"verb", "map-unfreeze"}, {"map", "map-1"}});
  done(about("proposal-accept", id));
  ASSERT_TRUE(eventually([&] { return keyframes(*anna_) == 3; }));

  done({{"verb", "rights-grant"},
        {"to", "anna"},
        {"map", "map-1"},
        {"right", "write"},
        {"within", {{"center", {50, 50, 50}}, {"radius", 1}}}});
  (void)propose(*anna_, 12);
  EXPECT_THAT(proposals()[0]["why"], HasSubstr("outside"));
}

TEST_F(ProposalsTest, AfterARollBackTheyAreJudgedByWhatThereIsOrDropped) {
  make_map();
  welcome(true);
  done({{"verb", "tag"}, {"map", "map-1"}, {"tag", "bare"}});
  ASSERT_TRUE(offer(*anna_, *anna_->snapshot(), 5).accepted);
  const auto rita = open_reader("rita");
  ASSERT_TRUE(eventually([&] { return keyframes(*rita) == 3; }));
  ASSERT_TRUE(offer(*rita, *rita->snapshot(), 9, KeyframeId{3}).kept_aside);
  ASSERT_TRUE(offer(*rita, *rita->snapshot(), 14).kept_aside);
  const json waiting = proposals();
  ASSERT_EQ(waiting.size(), 2U);
  done({{"verb", "roll-back"}, {"map", "map-1"}, {"tag", "bare"}});
  EXPECT_EQ(proposals(), waiting);
  EXPECT_THAT(refused(about("proposal-accept", waiting[0]["id"])), HasSubstr("it has been dropped"));
  EXPECT_EQ(proposals().size(), 1U);
  done(about("proposal-accept", waiting[1]["id"]));
  EXPECT_TRUE(eventually([&] { return keyframes(*anna_) == 3; }));
}

TEST_F(ProposalsTest, WhoMayNotReadTheMapProposesNothing) {
  make_map();
  welcome(true);
  const auto rita = open_reader("rita");
  const MapSnapshotPtr replica = rita->snapshot();
  done({{"verb", "rights-grant"}, {"to", "rita"}, {"map", "map-1"}, {"right", "none"}});
  EXPECT_FALSE(offer(*rita, *replica, 6).kept_aside);
  EXPECT_TRUE(proposals().empty());
}

}  // namespace
}  // namespace cairn
