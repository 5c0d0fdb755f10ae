// SPDX-License-Identifier: Apache-2.0
// Who may do what, over real DDS, without certificates and with them: each right against each request and
// each thing that is sent.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/utc.h"
#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/wire/security.h"
#include "server/admin/admin_client.h"
#include "server/service/system_clock.h"
#include "tests/integration/label_fixture.h"
#include "tests/integration/raw_client.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::eventually;
using ::testing::HasSubstr;
using testing::RawClient;

/// Of an open site, and of a secured one, whose default is made the same.
class RightsOverDds : public testing::LabelFixture, public ::testing::WithParamInterface<bool> {
 protected:
  explicit RightsOverDds(bool is_secured = GetParam()) : LabelFixture({}, is_secured) {
    connect();
    if (is_secured) ask_server({{"verb", "rights-default"}, {"right", "write"}, {"create", true}});
  }
  void connect() { admin_.emplace(operator_called("ops").value()); }
  /// In a secured site, with keys of that role.
  Result<AdminClient> operator_called(const std::string& name, Duty duty = Duty::kAdminister) {
    AdminClientOptions connection;
    connection.domain = service_options_.domain;
    if (keys_) connection.security = keys_->of(IdentityRole::kOperator, name, 24h, duty);
    return AdminClient::connect(connection);
  }
  json ask_server(const json& request) {
    auto answer = admin_->ask(request);
    EXPECT_TRUE(answer) << request.dump() << ": " << answer.error().message;
    return answer ? answer->content : json();
  }
  void grant(const std::string& to, const std::string& right, json more = json::object()) {
    json request{{"verb", "rights-grant"}, {"to", to}, {"map", to_hex(map_.bytes)}, {"right", right}};
    if (!more.is_null()) request.update(more);
    ask_server(request);
  }

  [[nodiscard]] PlaceView view() const {
    FrameImages images;
    images.build_pyramid(scene_.render(testing::Scene::pose(testing::kFirstView), 0)->view());
    return describe_place(images.pyramid, images.all_corners());
  }
  [[nodiscard]] bool is_answered(Session& session) {
    session.send_query(std::make_shared<const PlaceView>(view()), Timestamp{++asked_});
    std::optional<RelocalizationAnswer> answer;
    EXPECT_TRUE(eventually([&] { return (answer = session.take_relocalization_answer()).has_value(); }));
    return answer && std::ranges::any_of(answer->candidates, [&](const auto& c) { return c.map == map_; });
  }
  /// Within what a replica takes that is allowed: some tens of milliseconds.
  [[nodiscard]] bool is_sent(Session& session, bool is_expected) {
    session.use_map(map_);
    return session.wait_for_map(is_expected ? 60s : 1s);
  }
  /// Nothing: taken, or refused for what it is and not for who offers it.
  [[nodiscard]] std::string why_no_offer(Session& session) {
    testing::Frame frame = testing::make_offer(scene_, *anna_->snapshot(), 4);
    session.send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{4});
    std::vector<OfferReply> replies;
    EXPECT_TRUE(eventually([&] { return !(replies = session.take_offer_replies()).empty(); }));
    if (replies.empty() || replies[0].accepted) return {};
    const std::string& reason = replies[0].reason;
    for (const char* word : {"granted", "at this site", "frozen", "blocked", "does not know the map"})
      if (reason.find(word) != std::string::npos) return reason;
    return {};
  }
  [[nodiscard]] bool may_label(Session& session) {
    const auto reply = ask(session, new_label("of " + std::to_string(++asked_)));
    return reply && reply->done;
  }
  [[nodiscard]] bool may_remove(Session& session, LabelId label) {
    wire::ClientRequest request;
    request.action = wire::RequestAction::kRemoveLabel;
    request.map = map_;
    request.label = label;
    const auto reply = ask(session, request);
    return reply && reply->done;
  }

  /// All that a client can say of the scene, each with number `seq`.
  struct Everything {
    wire::MapSeed seed;
    wire::KeyframeOffer offer;
    wire::RelocQuery query;
    wire::ClientRequest request;
  };
  [[nodiscard]] Everything everything(const RawClient& client, uint64_t seq) {
    Everything all{testing::seed_of(client, seq, scene_),
                   testing::offer_of(client, seq, scene_, *anna_->snapshot(), 4),
                   testing::query_of(client, seq, view()), new_label("by a raw client")};
    all.request.client = client.id;
    all.request.command = {client.session, seq};
    return all;
  }
  /// Once more, whether the server has been heard or not.
  void say(RawClient& client, const Everything& all) {
    client.announce(scene_.camera()->parameters());
    client.spin();
    (void)client.seeds.write(all.seed);
    (void)client.offers.write(all.offer);
    (void)client.queries.write(all.query);
    (void)client.requests.write(all.request);
  }
  [[nodiscard]] size_t map_count() { return ask_server({{"verb", "maps"}})["maps"].size(); }
  /// As a client that keeps to no protocol; in a secured site, with the keys of that name.
  [[nodiscard]] RawClient raw_client(const std::string& name) {
    auto joining = RawClient::joining(service_options_.domain);
    if (keys_) joining.security = keys_->copied(keys_->of(IdentityRole::kClient, name));
    RawClient client(joining, name, scene_.camera());
    client.use_map(map_);
    return client;
  }

  std::optional<AdminClient> admin_;
  int64_t asked_ = 0;
};

/// So that what is expected not to pass elsewhere would pass here.
TEST_P(RightsOverDds, EverythingThatARawClientSaysIsTakenAndAnswered) {
  make_map();
  RawClient bob = raw_client("bob");
  const Everything all = everything(bob, 1);
  EXPECT_TRUE(eventually([&] {
    say(bob, all);
    return bob.has_every_answer();
  }));
  EXPECT_TRUE(eventually([&] { return texts(*anna_) == Texts{"by a raw client"}; }));
  EXPECT_TRUE(eventually([&] { return map_count() == 2; }));
  EXPECT_GT(bob.servers(), 0);
}

struct Case {
  const char* name;
  const char* right;  ///< that is granted; empty: none is
  json more;          ///< of the grant
  json before;        ///< another request, before the client comes; null: none
  json after;         ///< that takes it back
  bool reads, adds, writes;
};

TEST_P(RightsOverDds, EachRightAllowsWhatItSaysAndNoMore) {
  make_map();
  const std::string id = to_hex(map_.bytes);
  LabelId annas = add(*anna_, "vice");
  ask_server({{"verb", "rights-grant"}, {"to", "anna"}, {"map", id}, {"right", "manage"}});
  ask_server({{"verb", "rights-default"}, {"right", "none"}, {"create", false}});
  const json frozen{{"verb", "map-freeze"}, {"map", id}, {"why", "on show"}};
  const json thawed{{"verb", "map-unfreeze"}, {"map", id}};
  // Soon over: the client comes when it is.
  const std::string soon = to_utc({SystemClock().wall().nanoseconds + 2'000'000'000});
  const std::vector<Case> cases{
      {"none", "none", {}, {}, {}, false, false, false},
      {"default", "", {}, {}, {}, false, false, false},
      {"read", "read", {}, {}, {}, true, false, false},
      {"add", "add", {}, {}, {}, true, true, false},
      {"write", "write", {}, {}, {}, true, true, true},
      {"manage", "manage", {}, {}, {}, true, true, true},
      {"extent", "write", {{"within", {{"center", {0, 0, 0}}, {"radius", 100}}}}, {}, {}, true, true, true},
      {"expired", "write", {{"until", soon}}, {}, {}, false, false, false},
      {"frozen", "write", {}, frozen, thawed, true, false, false},
      {"blocked", "write", {}, {{"verb", "client-block"}, {"client", "blocked"}}, {}, false, false, false},
  };
  for (const Case& c : cases)
    if (*c.right != '\0') grant(c.name, c.right, c.more);
  ASSERT_TRUE(eventually([&] { return to_utc(SystemClock().wall()) > soon; }));
  for (const Case& c : cases) {
    SCOPED_TRACE(c.name);
    if (!c.before.is_null()) ask_server(c.before);
    const bool is_blocked = std::string(c.name) == "blocked";
    const auto session = is_blocked ? testing::open_session(client(c.name), scene_.camera()) : open(c.name);
    ASSERT_TRUE(!is_blocked || eventually([&] { return session->status().link == ServerLink::kRefused; }));
    EXPECT_EQ(is_answered(*session), c.reads);
    EXPECT_EQ(is_sent(*session, c.reads), c.reads);
    EXPECT_EQ(why_no_offer(*session).empty(), c.adds) << why_no_offer(*session);
    EXPECT_EQ(may_label(*session), c.adds);
    EXPECT_EQ(may_remove(*session, annas), c.writes);
    if (c.writes) annas = add(*anna_, "vice");
    if (!c.after.is_null()) ask_server(c.after);
  }
}

TEST_P(RightsOverDds, WhatIsRevokedIsGoneWithinASecondAndWhatIsGrantedComes) {
  make_map();
  const auto bob = open("bob");
  ASSERT_TRUE(is_sent(*bob, true));
  grant("bob", "none");  // in force when it is answered
  const Revision last = bob->snapshot()->revision;
  EXPECT_THAT(why_no_offer(*anna_), ::testing::IsEmpty());
  ASSERT_TRUE(eventually([&] { return anna_->snapshot()->revision > last; }));
  EXPECT_FALSE(eventually([&] { return bob->snapshot()->revision > last; }, 1s)) << "goes on receiving";
  EXPECT_FALSE(is_answered(*bob));
  EXPECT_THAT(why_no_offer(*bob), HasSubstr("does not know the map"));
  grant("bob", "read");
  EXPECT_TRUE(is_sent(*bob, true));
  EXPECT_TRUE(is_answered(*bob));
  EXPECT_THAT(why_no_offer(*bob), HasSubstr("bob may only read here, as granted by "));
  EXPECT_NE(anna_->snapshot(), nullptr) << "others are not disturbed";
}

TEST_P(RightsOverDds, WhoMadeAMapAndWhatBecameOfItsLabelsIsOnRecord) {
  make_map();
  const LabelId vice = add(*anna_, "vice");
  ask_server({{"verb", "label-rename"}, {"map", "map-1"}, {"label", vice.value}, {"text", "drill"}});
  EXPECT_TRUE(may_remove(*anna_, vice));
  const LabelId lamp = add(*anna_, "lamp");
  ask_server({{"verb", "label-remove"}, {"map", "map-1"}, {"label", lamp.value}});
  grant("bob", "read");
  const auto bob = open("bob");
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(may_label(*bob));
  std::vector<std::string> record;
  const json entries = ask_server({{"verb", "audit"}})["entries"];
  for (const json& entry : entries) {
    std::string who = entry["who"].get<std::string>();
    if (who.starts_with("operator")) who = "operator";
    if (!entry["action"].get<std::string>().starts_with("rights"))
      record.push_back(who + " " + entry["action"].get<std::string>() + ": " +
                       entry["object"].get<std::string>());
  }
  if (keys_) record.pop_back();  // the site was secured
  std::ranges::reverse(record);
  const std::string first = "map map-1, label " + std::to_string(vice.value);
  const std::string second = "map map-1, label " + std::to_string(lamp.value);
  EXPECT_THAT(record, ::testing::ElementsAre("client anna map make: map map-1",
                                             "client anna label place: " + first + ", text vice",
                                             "operator label rename: " + first + ", text drill",
                                             "client anna label remove: " + first + ", text drill",
                                             "client anna label place: " + second + ", text lamp",
                                             "operator label remove: " + second + ", text lamp",
                                             "client bob label place: map map-1"))
      << "the same refusal is on record once";
  EXPECT_THAT(entries[0]["outcome"].get<std::string>(),
              ::testing::StartsWith("refused: bob may only read here, as granted by "));
}

TEST_P(RightsOverDds, WhoMayNotMakeMapsIsToldWhy) {
  ask_server({{"verb", "rights-create"}, {"to", "anna"}, {"may", false}});
  anna_->send_seed(testing::make_seed(scene_));
  std::optional<SeedReply> reply;
  ASSERT_TRUE(eventually([&] { return (reply = anna_->take_seed_reply()).has_value(); }));
  EXPECT_FALSE(reply->answer);
  EXPECT_EQ(reply->reason, "client anna may not make maps; `cairnctl rights explain anna` says what decides");
}

TEST_P(RightsOverDds, RightsAndWhoChangedThemOutliveARestart) {
  make_map();
  grant("bob", "read");
  ask_server({{"verb", "rename"}, {"map", "map-1"}, {"name", "desk"}});
  admin_.reset();
  service_.reset();
  start_service_again();
  connect();
  const json rights = ask_server({{"verb", "rights"}});
  ASSERT_EQ(rights["grants"].size(), 1U);
  EXPECT_EQ(rights["grants"][0]["to"], "client bob");
  EXPECT_EQ(rights["grants"][0]["name"], "desk");
  const json entries = ask_server({{"verb", "audit"}})["entries"];
  ASSERT_EQ(entries.size(), keys_ ? 5U : 3U);
  EXPECT_EQ(entries[0]["action"], "rename");
  EXPECT_EQ(entries[0]["object"], "map map-1, name desk");
  EXPECT_EQ(entries[1]["action"], "rights grant");
  EXPECT_THAT(entries[1]["who"].get<std::string>(), HasSubstr(keys_ ? "operator ops" : "operator "));
}

/// The builder's frames beyond the extent are refused by name; those within are taken.
TEST_P(RightsOverDds, AnExtentBoundsWhatOneAddsAndNobodyElse) {
  make_map();
  const Eigen::Vector3d at = anna_->snapshot()->find(KeyframeId{1})->camera_from_map.center();
  const auto sphere = [&](double radius) {
    return json{{"within", {{"center", {at.x(), at.y(), at.z() + 50}}, {"radius", radius}}}};
  };
  grant("bob", "write", sphere(10));
  const auto bob = open("bob");
  testing::Frame frame = testing::make_offer(scene_, *anna_->snapshot(), 4);
  bob->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{4});
  std::vector<OfferReply> replies;
  ASSERT_TRUE(eventually([&] { return !(replies = bob->take_offer_replies()).empty(); }));
  EXPECT_FALSE(replies[0].accepted);
  EXPECT_THAT(replies[0].reason, HasSubstr("is outside of where this client may let the map grow"));
  EXPECT_THAT(why_no_offer(*anna_), ::testing::IsEmpty());
  const auto label = ask(*bob, new_label("far away"));
  ASSERT_TRUE(label);
  EXPECT_FALSE(label->done);
  EXPECT_THAT(label->reason, HasSubstr("the label, at "));
  EXPECT_TRUE(may_label(*anna_));
  grant("bob", "write", sphere(1000));
  EXPECT_TRUE(may_label(*bob));
}

/// Where nobody may more than read, but make maps: in its own the maker may write, also after a restart.
TEST_P(RightsOverDds, WhoMakesAMapMayLetItGrow) {
  ask_server({{"verb", "rights-default"}, {"right", "read"}, {"create", true}});
  make_map();
  EXPECT_THAT(why_no_offer(*anna_), ::testing::IsEmpty());
  EXPECT_THAT(why_no_offer(*open("bob")), HasSubstr("may only read here, as everyone at this site"));
  const json grants = ask_server({{"verb", "rights"}})["grants"];
  ASSERT_EQ(grants.size(), 1U);
  EXPECT_EQ(grants[0]["to"], "client anna");
  EXPECT_EQ(grants[0]["by"], "the server to the map's maker");
  admin_.reset();
  service_.reset();
  start_service_again();
  connect();
  EXPECT_EQ(ask_server({{"verb", "rights"}})["grants"], grants);
}

/// The cameras of the map stand outside of its points.
TEST_P(RightsOverDds, WithinItsBoundsAndAMarginAMapGrowsAsBefore) {
  make_map();
  ask_server({{"verb", "map-extent"}, {"to", "anna"}, {"map", "map-1"}, {"within", {{"margin", 0.2}}}});
  EXPECT_THAT(why_no_offer(*anna_), ::testing::Not(HasSubstr("outside")));
  testing::Frame frame = testing::make_offer(scene_, *anna_->snapshot(), 5);
  anna_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{5});
  std::vector<OfferReply> replies;
  ASSERT_TRUE(eventually([&] { return !(replies = anna_->take_offer_replies()).empty(); }));
  EXPECT_THAT(replies[0].reason, ::testing::Not(HasSubstr("outside")));
}

INSTANTIATE_TEST_SUITE_P(Site, RightsOverDds, ::testing::Bool(),
                         [](const auto& site) { return site.param ? "secured" : "open"; });

/// What there is in a secured site only.
class KeysOverDds : public RightsOverDds {
 protected:
  KeysOverDds() : RightsOverDds(true) {}
  /// Nothing is said to it and nothing of it is taken, though it tries everything for some time.
  void expect_nothing_passes(RawClient& client, uint64_t seq = 1) {
    const Everything all = everything(client, seq);
    const Texts labels = texts(*anna_);
    const size_t maps = map_count();
    EXPECT_FALSE(eventually(
        [&] {
          say(client, all);
          return client.has_heard_anything();
        },
        1500ms));
    EXPECT_EQ(map_count(), maps);
    EXPECT_EQ(texts(*anna_), labels);
  }
  void expect_nothing_passes(Session& session) {
    session.use_map(map_);
    session.send_query(std::make_shared<const PlaceView>(view()), Timestamp{++asked_});
    EXPECT_FALSE(eventually([&] { return session.take_relocalization_answer().has_value(); }, 1500ms));
  }
  json audit_of(const std::string& action) {
    return ask_server({{"verb", "audit"}, {"action", action}})["entries"];
  }
};

TEST_F(KeysOverDds, AForeignCertificateNoneAndOneThatHasExpiredPassNothing) {
  make_map();
  testing::KeyRing foreign;
  SessionOptions stranger = client("anna");
  stranger.name = "mallory";
  stranger.security = foreign.of(IdentityRole::kClient, "mallory");
  std::filesystem::copy_file(std::filesystem::path(service_options_.security) / "tag",
                             std::filesystem::path(stranger.security) / "tag",
                             std::filesystem::copy_options::overwrite_existing);
  SessionOptions nobody = client("anna");
  nobody.security.clear();  // and with a name that has rights
  SessionOptions brief = client("anna");
  brief.name = "brief";
  brief.security = keys_->of(IdentityRole::kClient, "brief", 6s);
  const auto expiring = testing::open_known_session(brief, scene_.camera());
  for (const SessionOptions& options : {stranger, nobody}) {
    SCOPED_TRACE(options.name);
    // Each knows the tag of the site, without which nobody would as much as answer.
    auto joining = RawClient::joining(options.domain);
    joining.security = options.security;
    if (options.security.empty())
      joining.tag = wire::read_security(service_options_.security)->tag + "." + joining.tag;
    RawClient raw(joining, options.name, scene_.camera());
    raw.use_map(map_);
    expect_nothing_passes(raw);
    EXPECT_EQ(raw.servers(), 0) << "the middleware lets it write to the server";
    EXPECT_FALSE(raw.offer_verdict) << "nothing is said to it at all";
    const auto session = testing::open_session(options, scene_.camera());
    expect_nothing_passes(*session);
    EXPECT_NE(session->status().link, ServerLink::kConnected);
    EXPECT_EQ(session->snapshot(), nullptr);
    if (!options.security.empty()) continue;
    EXPECT_TRUE(eventually([&] {
      raw.spin();
      const json entries = audit_of("not let in");
      return std::any_of(entries.begin(), entries.end(), [](const json& entry) {
        return entry["outcome"].get<std::string>().starts_with("no keys of this site were shown (process ");
      });
    })) << "who has no certificate at all is on record";
  }
  ASSERT_TRUE(eventually([&] { return expiring->status().link != ServerLink::kConnected; }));
  expect_nothing_passes(*expiring);
  const auto late = Session::open(brief, scene_.camera(), null_logger());
  ASSERT_FALSE(late);
  EXPECT_THAT(late.error().message, HasSubstr("has expired"));
  EXPECT_THAT(late.error().message, HasSubstr("`cairnctl keys renew client brief`"));
  keys_->renew(IdentityRole::kClient, "brief");
  EXPECT_TRUE(eventually([&] { return expiring->status().link == ServerLink::kConnected; }));
  EXPECT_TRUE(is_answered(*expiring));
}

TEST_F(KeysOverDds, WhoIsRevokedIsCutOffWhileItGoesOnTryingAndThatIsOnRecord) {
  make_map();
  SessionOptions options = client("bob");
  options.security = keys_->copied(options.security);
  auto bob = testing::open_known_session(options, scene_.camera());
  ASSERT_TRUE(is_sent(*bob, true));
  keys_->revoke(IdentityRole::kClient, "bob");
  const auto is_told = [](const Session& session) {
    const SessionStatus status = session.status();
    return status.link == ServerLink::kRefused &&
           status.text.find("an operator has revoked the keys") != std::string::npos;
  };
  ASSERT_TRUE(eventually([&] { return is_told(*bob); })) << bob->status().text;
  EXPECT_TRUE(ask_server({{"verb", "clients"}})["clients"][1]["revoked"].get<bool>());
  const Revision last = bob->snapshot()->revision;
  EXPECT_THAT(why_no_offer(*anna_), ::testing::IsEmpty());
  ASSERT_TRUE(eventually([&] { return anna_->snapshot()->revision > last; }));
  expect_nothing_passes(*bob);
  EXPECT_EQ(bob->snapshot()->revision, last);
  bob.reset();
  const size_t tries = audit_of("turned away").size();
  EXPECT_LE(tries, 3U) << "however often it says something";
  const auto again = testing::open_session(options, scene_.camera());
  ASSERT_TRUE(eventually([&] { return is_told(*again); })) << again->status().text;
  EXPECT_TRUE(eventually([&] { return audit_of("turned away").size() > tries; }))
      << "another process that tries is on record at once";
  expect_nothing_passes(*again);
  EXPECT_EQ(again->snapshot(), nullptr);
  for (const json& entry : audit_of("turned away")) {
    EXPECT_EQ(entry["who"], "client bob");
    EXPECT_THAT(entry["outcome"].get<std::string>(), ::testing::StartsWith("its keys were revoked"));
  }
  EXPECT_EQ(anna_->status().link, ServerLink::kConnected) << "others are not disturbed";
}

/// The middleware lets it speak until the server is started again: what it says reaches the server's readers.
TEST_F(KeysOverDds, WhatARevokedClientGoesOnSayingArrivesAndIsNotTaken) {
  make_map();
  RawClient bob = raw_client("bob");
  const Everything first = everything(bob, 1);
  ASSERT_TRUE(eventually([&] {
    say(bob, first);
    return bob.has_every_answer();
  }));
  ASSERT_TRUE(eventually([&] { return map_count() == 2 && texts(*anna_).size() == 1; }));
  keys_->revoke(IdentityRole::kClient, "bob");
  ASSERT_TRUE(eventually([&] {
    bob.spin();
    return !audit_of("turned away").empty() && !bob.why_not_served().empty();
  }));
  EXPECT_THAT(bob.why_not_served(), HasSubstr("an operator has revoked the keys of this device"));
  bob.spin();  // what was said before
  bob.forget_what_was_heard();
  expect_nothing_passes(bob, 2);
  EXPECT_GT(bob.servers(), 0) << "nothing of this says what the server does with it";
}

TEST_F(KeysOverDds, AnOperatorMayWhatItsRoleSaysAndOneThatIsRevokedIsTold) {
  make_map();
  const json look{{"verb", "status"}};
  const json rename{{"verb", "rename"}, {"map", to_hex(map_.bytes)}, {"name", "desk"}};
  const json block{{"verb", "client-block"}, {"client", "eve"}};
  auto watcher = operator_called("wat", Duty::kWatch).value();
  auto curator = operator_called("cur", Duty::kCurate).value();
  // The register of the server knows both by now; it looks at it four times a second.
  ASSERT_TRUE(eventually([&] { return curator.ask(rename).has_value(); }));
  EXPECT_TRUE(watcher.ask(look));
  EXPECT_EQ(watcher.ask(rename).error().message,
            "operator wat has the role watch; this needs the role curate");
  EXPECT_EQ(curator.ask(block).error().message,
            "operator cur has the role curate; this needs the role administer");
  const json freeze{{"verb", "map-freeze"}, {"map", to_hex(map_.bytes)}};
  EXPECT_EQ(watcher.ask(freeze).error().message,
            "operator wat has the role watch; this needs the role curate");
  EXPECT_TRUE(curator.ask(freeze)) << "who looks after maps";
  EXPECT_TRUE(admin_->ask(block));
  EXPECT_EQ(admin_->ask({{"verb", 5}}).error().message, "a request without 'verb', a text");
  // As somebody who has copied the curator's keys and only listens.
  auto joining = RawClient::joining(service_options_.domain);
  joining.security = keys_->copied(keys_->of(IdentityRole::kOperator, "cur"));
  const auto listener = testing::value_of(wire::Participant::create(joining));
  const auto replies =
      testing::value_of(wire::Reader<wire::AdminReply>::create(listener, wire::operator_partition("cur")));
  ASSERT_TRUE(eventually([&] { return replies.matched() == 1; }));
  auto second = operator_called("ops").value();  // the same person in another window
  EXPECT_TRUE(second.ask(look));
  EXPECT_TRUE(admin_->ask(look));
  keys_->revoke(IdentityRole::kOperator, "cur");
  EXPECT_TRUE(eventually([&] { return replies.matched() == 0; })) << "the last answer can still be had";
  ASSERT_TRUE(eventually([&] { return !curator.ask(look); }));
  EXPECT_EQ(curator.ask(look).error().message, "operator cur: its keys were revoked");
  EXPECT_EQ(audit_of("rename")[0]["who"], "operator wat");
  EXPECT_EQ(audit_of("turned away")[0]["who"], "operator cur");
}

}  // namespace
}  // namespace cairn
