// SPDX-License-Identifier: Apache-2.0
#include "server/service/rights_verbs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/service/admin_json.h"

namespace cairn {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr Timestamp kNow{1'800'000'000'000'000'000};  // 2027-01-15T08:00:00Z
const MapId kDesk{{1}};

class RightsVerbsTest : public ::testing::Test {
 protected:
  static std::optional<NamedMap> find(const std::string& name) {
    if (name != "desk" && name != to_hex(kDesk.bytes)) return std::nullopt;
    return NamedMap{kDesk, "desk", {{0, 0, 0}, {2, 1, 1}}};
  }
  /// The error's message, or what was done, which is in force then.
  std::string ask(const json& request) {
    const auto asks = read_admin_request(request.dump());
    if (!asks) return asks.error().message;
    if (const auto* unfit = std::get_if<asked::Unfit>(&asks->what)) return unfit->why.message;
    auto change = change_rights(rights_, std::get<asked::ChangeRights>(asks->what), "ann", find, kNow);
    if (!change) return change.error().message;
    rights_ = std::move(change->rights);
    entry_ = change->entry;
    note_ = note_on_names(rights_, std::get<asked::ChangeRights>(asks->what), kKnown);
    return entry_.action + ": " + entry_.object;
  }
  [[nodiscard]] Ruling ruling(const std::string& client) const { return rights_.rule(client, kDesk, kNow); }

  Rights rights_{Right::kNone, false};
  AuditEntry entry_;
  std::string note_;
  const KnownClients kKnown{{"bob", "builder-1"}, false};
};

TEST_F(RightsVerbsTest, WhatIsGrantedCountsAndIsWrittenDown) {
  EXPECT_EQ(ask({{"verb", "rights-grant"},
                 {"to", "bob"},
                 {"map", "desk"},
                 {"right", "write"},
                 {"until", "2027-02-01"}}),
            "rights grant: client bob, map desk: write until 2027-02-01T00:00:00Z");
  EXPECT_EQ(ruling("bob").right, Right::kWrite);
  EXPECT_EQ(entry_, (AuditEntry{0, kNow, "operator ann", "rights grant",
                                "client bob, map desk: write until 2027-02-01T00:00:00Z", "done"}));
  EXPECT_EQ(ask({{"verb", "rights-revoke"}, {"to", "bob"}, {"map", "desk"}}),
            "rights revoke: client bob, map desk");
  EXPECT_EQ(ruling("bob").right, Right::kNone);
}

TEST_F(RightsVerbsTest, AnExtentIsABoxASphereOrTheMapsBoundsWithAMargin) {
  const auto grant = [&](json within) {
    return ask(
        {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "write"}, {"within", within}});
  };
  EXPECT_THAT(grant({{"margin", 0.5}}), HasSubstr("within box -0.50 -0.50 -0.50 to 2.50 1.50 1.50"));
  EXPECT_TRUE(contains(*ruling("bob").extent, {2.4, 0, 0}));
  EXPECT_THAT(grant({{"center", {0, 0, 0}}, {"radius", 2}}), HasSubstr("within 2.00 around"));
  EXPECT_THAT(grant({{"box", {{0, 0, 0}, {1, 1, 1}}}}), HasSubstr("within box"));
  EXPECT_THAT(grant({{"box", {{0, 0, 0}}}}), HasSubstr("two corners"));
  EXPECT_THAT(grant({{"margin", -1}}), HasSubstr("negative"));
  EXPECT_THAT(grant({{"center", {0, 0}}, {"radius", 2}}), HasSubstr("three numbers"));
  EXPECT_THAT(grant("everywhere"), HasSubstr("no extent"));
}

/// Whatever the right comes from, an extent limits it and never raises it.
TEST_F(RightsVerbsTest, AnExtentLeavesTheRight) {
  const auto limit = [&](const char* to, json within) {
    json request{{"verb", "map-extent"}, {"to", to}, {"map", "desk"}};
    if (!within.is_null()) request["within"] = std::move(within);
    return ask(request);
  };
  const json room{{"margin", 0.5}};
  const auto grant = [&](const char* to, const char* map, const char* right) {
    ask({{"verb", "rights-grant"}, {"to", to}, {"map", map}, {"right", right}});
  };
  EXPECT_THAT(limit("bob", room), HasSubstr("client bob has the right 'none' in map desk"));
  grant("bob", "desk", "read");
  EXPECT_THAT(limit("bob", room), HasSubstr("has the right 'read'"));
  EXPECT_EQ(ruling("bob").right, Right::kRead);
  grant("bob", "all", "write");
  grant("bob", "desk", "add");
  EXPECT_THAT(limit("bob", room), HasSubstr("map extent: client bob, map desk: add within box"));
  EXPECT_EQ(ruling("bob").right, Right::kAdd);
  EXPECT_TRUE(ruling("bob").extent);
  EXPECT_EQ(limit("bob", nullptr), "map extent: client bob, map desk: add");
  EXPECT_FALSE(ruling("bob").extent);
  grant("group crew", "all", "add");
  EXPECT_THAT(limit("group crew", room), HasSubstr("group crew, map desk: add within"));
  EXPECT_THAT(limit("everyone", room), HasSubstr("everyone has the right 'none'"));
  ask({{"verb", "rights-default"}, {"right", "write"}});
  ask({{"verb", "map-freeze"}, {"map", "desk"}, {"why", "on show"}});
  grant("eve", "all", "none");
  EXPECT_THAT(limit("everyone", room), HasSubstr("client eve has the right 'none' here"));
  grant("eve", "all", "write");
  EXPECT_THAT(limit("everyone", room), HasSubstr("everyone, map desk: write within"));
  EXPECT_THAT(limit("zoe", room), HasSubstr("client zoe, map desk: write within"));
  ask({{"verb", "client-block"}, {"client", "bob"}});
  EXPECT_THAT(limit("bob", room), HasSubstr("client bob, map desk: add within"));
}

/// Of several groups the one that grants most counts; who is in none of them stands in nobody's way.
TEST_F(RightsVerbsTest, AnExtentOfAGroupRaisesNobodyInAnother) {
  const auto say = [&](json request) { return ask(request); };
  say({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"bob", "eve"}}});
  say({{"verb", "rights-group"}, {"group", "guests"}, {"members", {"eve"}}});
  say({{"verb", "rights-grant"}, {"to", "group crew"}, {"map", "all"}, {"right", "write"}});
  say({{"verb", "rights-grant"}, {"to", "group guests"}, {"map", "desk"}, {"right", "read"}});
  say({{"verb", "rights-grant"}, {"to", "zoe"}, {"map", "all"}, {"right", "read"}});
  ASSERT_EQ(ruling("eve").right, Right::kRead);
  const json extent{
      {"verb", "map-extent"}, {"to", "group crew"}, {"map", "desk"}, {"within", {{"margin", 1}}}};
  EXPECT_THAT(say(extent), HasSubstr("client eve has the right 'read' here"));
  EXPECT_EQ(ruling("eve").right, Right::kRead);
  say({{"verb", "rights-grant"}, {"to", "eve"}, {"map", "desk"}, {"right", "read"}});
  EXPECT_THAT(say(extent), HasSubstr("write within"));
  EXPECT_EQ(ruling("eve").right, Right::kRead);
  EXPECT_TRUE(ruling("bob").extent);
}

/// Neither is what somebody may do once he is not blocked any more, or where, or later.
TEST_F(RightsVerbsTest, AnExtentWidensNoOtherGrant) {
  const auto grant = [&](const char* to, const char* map, const char* right, json more = json::object()) {
    json request{{"verb", "rights-grant"}, {"to", to}, {"map", map}, {"right", right}};
    request.update(more);
    ask(request);
  };
  const auto limit = [&](const char* to, json within) {
    json request{{"verb", "map-extent"}, {"to", to}, {"map", "desk"}};
    if (!within.is_null()) request["within"] = std::move(within);
    return ask(request);
  };
  const json narrow{{"center", {0, 0, 0}}, {"radius", 1}};
  const json wide{{"center", {0, 0, 0}}, {"radius", 9}};
  ask({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"bob", "eve"}}});
  ask({{"verb", "rights-group"}, {"group", "guests"}, {"members", {"eve"}}});
  grant("group crew", "all", "write");
  grant("group guests", "desk", "read");
  ask({{"verb", "client-block"}, {"client", "eve"}});
  EXPECT_THAT(limit("group crew", wide), HasSubstr("client eve has the right 'read' here, which"));
  ask({{"verb", "client-unblock"}, {"client", "eve"}});

  grant("group guests", "desk", "write", {{"within", narrow}});
  EXPECT_THAT(limit("group crew", wide),
              HasSubstr("client eve has the right 'write' here within 1.00 around"));
  EXPECT_THAT(limit("group crew", nullptr),
              HasSubstr("client eve has the right 'write' here within 1.00 around"));

  grant("eve", "all", "none");
  grant("eve", "desk", "write", {{"until", "2027-01-16T08:00:00Z"}});
  EXPECT_THAT(limit("group crew", wide), HasSubstr("from 2027-01-16T08:00:00Z on"));

  grant("eve", "desk", "write", {{"within", narrow}});
  EXPECT_THAT(limit("eve", wide), HasSubstr("client eve, map desk: write within 9.00")) << "his own";
  EXPECT_THAT(limit("group crew", wide), HasSubstr("group crew, map desk: write within 9.00"));
  EXPECT_THAT(limit("group crew", narrow), HasSubstr("group crew, map desk: write within 1.00"));
  EXPECT_THAT(limit("group crew", nullptr), HasSubstr("group crew, map desk: write"));
}

TEST_F(RightsVerbsTest, WhoFreezesAMapAgainWithoutAWordLeavesTheReason) {
  ask({{"verb", "map-freeze"}, {"map", "desk"}, {"why", "on show"}});
  EXPECT_EQ(ask({{"verb", "map-freeze"}, {"map", "desk"}}), "map freeze: map desk: on show");
  EXPECT_THAT(rights_.why_frozen(kDesk), HasSubstr("on show"));
}

TEST_F(RightsVerbsTest, GroupsDefaultsAndWhoMakesMaps) {
  EXPECT_EQ(ask({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"bob", "eve"}}}),
            "rights group: group crew: bob eve");
  ask({{"verb", "rights-grant"}, {"to", "group crew"}, {"map", "all"}, {"right", "add"}});
  EXPECT_EQ(ruling("eve").right, Right::kAdd);
  ask({{"verb", "rights-default"}, {"right", "read"}});
  EXPECT_EQ(ruling("zoe").right, Right::kRead);
  EXPECT_EQ(rights_.rule_on_creating("eve").right, Right::kNone);
  ask({{"verb", "rights-create"}, {"to", "group crew"}, {"may", true}});
  EXPECT_EQ(rights_.rule_on_creating("eve").right, Right::kWrite);
  ask({{"verb", "rights-create"}, {"to", "group crew"}, {"may", nullptr}});
  EXPECT_EQ(rights_.rule_on_creating("eve").right, Right::kNone);
}

TEST_F(RightsVerbsTest, MapsAreFrozenAndClientsBlockedUntilThatIsTakenBack) {
  ask({{"verb", "rights-default"}, {"right", "write"}});
  EXPECT_EQ(ask({{"verb", "map-freeze"}, {"map", "desk"}, {"why", "on show"}}),
            "map freeze: map desk: on show");
  EXPECT_EQ(ruling("bob").right, Right::kRead);
  EXPECT_EQ(ask({{"verb", "map-unfreeze"}, {"map", "desk"}}), "map unfreeze: map desk");
  EXPECT_THAT(ask({{"verb", "map-unfreeze"}, {"map", "desk"}}), HasSubstr("is not frozen"));
  ask({{"verb", "client-block"}, {"client", "bob"}});
  EXPECT_EQ(ruling("bob").right, Right::kNone);
  ask({{"verb", "client-unblock"}, {"client", "bob"}});
  EXPECT_EQ(ruling("bob").right, Right::kWrite);
  EXPECT_THAT(ask({{"verb", "client-unblock"}, {"client", "bob"}}), HasSubstr("is not blocked"));
}

TEST_F(RightsVerbsTest, ProposalsAreWelcomeInAMapOrEverywhere) {
  const auto welcome = [&](const char* map, json yes) {
    return ask({{"verb", "proposals-welcome"}, {"map", map}, {"welcome", std::move(yes)}});
  };
  EXPECT_EQ(welcome("desk", true), "proposals welcome: map desk: on");
  EXPECT_EQ(entry_.action, "proposals welcome");
  EXPECT_TRUE(rights_.welcomes_proposals(kDesk));
  EXPECT_FALSE(rights_.welcomes_proposals(MapId{{2}}));
  EXPECT_EQ(welcome("all", true), "proposals welcome: all maps: on");
  EXPECT_TRUE(rights_.welcomes_proposals(MapId{{2}}));
  EXPECT_EQ(welcome("desk", false), "proposals welcome: map desk: off");
  EXPECT_FALSE(rights_.welcomes_proposals(kDesk));
  EXPECT_EQ(welcome("desk", nullptr), "proposals welcome: map desk: as in all maps");
  EXPECT_TRUE(rights_.welcomes_proposals(kDesk));
  EXPECT_THAT(welcome("all", nullptr), HasSubstr("'welcome' is missing"));
  EXPECT_THAT(welcome("bench", true), HasSubstr("no map is called 'bench'"));
}

TEST_F(RightsVerbsTest, WhatCannotBeIsRefusedAndChangesNothing) {
  const auto before = rights_.table();
  EXPECT_THAT(ask({{"verb", "rights-grant"}, {"to", "bob"}, {"map", "bench"}, {"right", "read"}}),
              HasSubstr("no map is called 'bench'"));
  EXPECT_THAT(ask({{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "reed"}}),
              HasSubstr("did you mean read?"));
  EXPECT_THAT(ask({{"verb", "rights-grant"},
                   {"to", "bob"},
                   {"map", "desk"},
                   {"right", "read"},
                   {"until", "2020-01-01"}}),
              HasSubstr("is over already"));
  EXPECT_THAT(ask({{"verb", "rights-grant"}, {"map", "desk"}, {"right", "read"}}),
              HasSubstr("'to' is missing"));
  EXPECT_THAT(ask({{"verb", "rights-grant"}, {"to", 7}, {"map", "desk"}, {"right", "read"}}),
              HasSubstr("is no text"));
  EXPECT_THAT(ask({{"verb", "rights-revoke"}, {"to", "bob"}, {"map", "all"}}),
              HasSubstr("nothing is granted"));
  EXPECT_THAT(ask({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"B!"}}}), HasSubstr("'B!'"));
  EXPECT_EQ(rights_.table(), before);
}

TEST_F(RightsVerbsTest, ANameThatNobodyHasIsToldAndTheRuleHoldsAllTheSame) {
  ask({{"verb", "rights-grant"}, {"to", "builder-l"}, {"map", "desk"}, {"right", "write"}});
  EXPECT_EQ(note_,
            "nobody called 'builder-l' has connected since the server started; did you mean builder-1?");
  EXPECT_EQ(ruling("builder-l").right, Right::kWrite);
  ask({{"verb", "client-block"}, {"client", "nobody"}});
  EXPECT_THAT(note_, HasSubstr("'nobody'"));
  ask({{"verb", "rights-create"}, {"to", "zoe"}, {"may", true}});
  EXPECT_THAT(note_, HasSubstr("'zoe'"));
  ask({{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "write"}});
  EXPECT_EQ(note_, "");
  ask({{"verb", "rights-grant"}, {"to", "everyone"}, {"map", "desk"}, {"right", "read"}});
  EXPECT_EQ(note_, "");
  const auto explained = explain_rights(rights_, {"nobody", "desk"}, find, {{}, true}, kNow);
  ASSERT_TRUE(explained);
  EXPECT_EQ(content_of(*explained)["note"],
            "nobody called 'nobody' has keys here or has connected since the server started");
  const auto revoked = explain_rights(rights_, {"bob", "desk"}, find, {{"bob"}, true, {"bob"}}, kNow);
  ASSERT_TRUE(revoked);
  EXPECT_THAT(content_of(*revoked)["note"].get<std::string>(),
              HasSubstr("the keys of client bob are revoked"));
}

TEST_F(RightsVerbsTest, AGroupThatIsNotThereYetIsToldWithTheRemedy) {
  ask({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"bob", "eve"}}});
  EXPECT_THAT(note_, HasSubstr("nobody called 'eve'")) << "of a member, too";
  EXPECT_THAT(note_, testing::Not(HasSubstr("'bob'")));
  ask({{"verb", "rights-grant"}, {"to", "group crew"}, {"map", "all"}, {"right", "read"}});
  EXPECT_EQ(note_, "");
  ask({{"verb", "rights-grant"}, {"to", "group crw"}, {"map", "all"}, {"right", "read"}});
  EXPECT_EQ(
      note_,
      "no group is called 'crw' yet; `cairnctl rights group crw CLIENT...` makes it; did you mean crew?");
  rights_.set_groups_of_keys({{"hand-9", {"crw"}}});
  ask({{"verb", "rights-grant"}, {"to", "group crw"}, {"map", "all"}, {"right", "read"}});
  EXPECT_EQ(note_, "") << "a group of keys is one";
}

TEST_F(RightsVerbsTest, AnExplanationSaysWhatGroupsTheClientIsInAndWhatSaysSo) {
  ask({{"verb", "rights-group"}, {"group", "crew"}, {"members", {"bob"}}});
  rights_.set_groups_of_keys({{"bob", {"night"}}});
  const auto explained = explain_rights(rights_, {"bob", "desk"}, find, kKnown, kNow);
  ASSERT_TRUE(explained);
  const json said = content_of(*explained);
  EXPECT_FALSE(said.contains("note"));
  EXPECT_EQ(said["groups"], json::array({{{"group", "crew"}, {"by_rights", true}, {"by_keys", false}},
                                         {{"group", "night"}, {"by_rights", false}, {"by_keys", true}}}));
}

TEST_F(RightsVerbsTest, AnExplanationSaysWhatDecides) {
  ask({{"verb", "rights-grant"}, {"to", "everyone"}, {"map", "all"}, {"right", "read"}});
  ask({{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "manage"}});
  const auto explained = explain_rights(rights_, {"bob", "desk"}, find, kKnown, kNow);
  ASSERT_TRUE(explained) << explained.error().message;
  const json said = content_of(*explained);
  EXPECT_EQ(said["right"], "manage");
  EXPECT_EQ(said["rules"][0], (json{{"rule", "client bob, this map: manage"}, {"part", "decides"}}));
  EXPECT_EQ(said["rules"][1]["part"], "is outweighed");
  EXPECT_FALSE(explain_rights(rights_, {"group crew", "desk"}, find, kKnown, kNow));
}

TEST_F(RightsVerbsTest, AllRulesAreShown) {
  ask({{"verb", "rights-grant"},
       {"to", "bob"},
       {"map", "desk"},
       {"right", "write"},
       {"within", {{"margin", 1}}}});
  ask({{"verb", "map-freeze"}, {"map", "desk"}});
  const json shown = content_of(told::Rights{rights_.table(), {{kDesk, "desk"}}, kNow, {}, true});
  EXPECT_EQ(shown["default"], "none");
  EXPECT_EQ(shown["grants"][0]["name"], "desk");
  EXPECT_THAT(shown["grants"][0]["within"].get<std::string>(), HasSubstr("box"));
  EXPECT_EQ(shown["frozen"][0]["by"], "ann");
}

}  // namespace
}  // namespace cairn
