// SPDX-License-Identifier: Apache-2.0
#include "server/access/rights.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/access/rights_policy.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;
using Kind = Subject::Kind;
using Part = RuleSeen::Part;

constexpr Timestamp kNow{1'800'000'000'000'000'000};
constexpr Timestamp kLater{kNow.nanoseconds + 60'000'000'000};
const Subject kEveryone{};
const Subject kAnn{Kind::kClient, "ann"};
const Subject kCrew{Kind::kGroup, "crew"};
const Subject kGuests{Kind::kGroup, "guests"};

MapId map_id(uint8_t n) {
  MapId id;
  id.bytes[0] = n;
  return id;
}
const MapId kDesk = map_id(1);
const MapId kBench = map_id(2);

class RightsTest : public ::testing::Test {
 protected:
  RightsTest() {
    EXPECT_TRUE(rights_.put_group("crew", {"ann", "bob"}));
    EXPECT_TRUE(rights_.put_group("guests", {"ann", "eve"}));
  }
  void grant(const Subject& subject, std::optional<MapId> map, Right right,
             std::optional<Timestamp> expires = {}, std::optional<Extent> extent = {}) {
    const Status granted = rights_.grant({subject, map, right, extent, expires, "ops", kNow});
    EXPECT_TRUE(granted) << granted.error().message;
  }
  [[nodiscard]] Right right(const std::string& client, const MapId& map, Timestamp now = kNow) const {
    return rights_.rule(client, map, now).right;
  }
  Rights rights_{Right::kNone, false};
};

TEST_F(RightsTest, WhoHasMadeAMapMayWriteInItUntilSomethingElseIsGranted) {
  ASSERT_TRUE(rights_.let_maker_write("ann", kDesk, kNow));
  EXPECT_EQ(right("ann", kDesk), Right::kWrite);
  EXPECT_EQ(right("ann", kBench), Right::kNone);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason,
            "ann may write here, as granted by the server to the map's maker");
  grant(kAnn, kDesk, Right::kRead);
  ASSERT_TRUE(rights_.let_maker_write("ann", kDesk, kNow));
  EXPECT_EQ(right("ann", kDesk), Right::kRead);
}

/// Names of an open site are believed, not proven: a grant of an operator was meant for somebody, this was
/// not.
TEST_F(RightsTest, WhatMakersHaveGoesWhenNamesAreToBeProven) {
  ASSERT_TRUE(rights_.let_maker_write("ann", kDesk, kNow));
  grant(kAnn, kBench, Right::kAdd);
  rights_.close_to_unnamed();
  EXPECT_EQ(right("ann", kDesk), Right::kNone);
  EXPECT_EQ(right("ann", kBench), Right::kAdd);
}

TEST_F(RightsTest, WhoIsNotNamedHasWhatTheSiteGivesToAll) {
  EXPECT_EQ(right("zoe", kDesk), Right::kNone);
  rights_.set_standard(Right::kWrite, true);
  EXPECT_EQ(right("zoe", kDesk), Right::kWrite);
}

TEST_F(RightsTest, TheMapIsBeforeAllMapsAndTheClientBeforeItsGroupsAndThoseBeforeEveryone) {
  // In ascending order of what decides; each next one outweighs those before.
  const std::vector<std::pair<Subject, std::optional<MapId>>> order{
      {kEveryone, {}}, {kCrew, {}}, {kAnn, {}}, {kEveryone, kDesk}, {kCrew, kDesk}, {kAnn, kDesk}};
  Right next = Right::kManage;
  for (const auto& [subject, map] : order) {
    grant(subject, map, next);
    EXPECT_EQ(right("ann", kDesk), next) << to_string(subject);
    next = next == Right::kManage ? Right::kRead : Right::kManage;
  }
  EXPECT_EQ(right("ann", kBench), Right::kManage) << "of all maps, to the client";
}

TEST_F(RightsTest, OfSeveralGroupsTheOneThatGrantsMostCounts) {
  grant(kGuests, kDesk, Right::kRead);
  grant(kCrew, kDesk, Right::kWrite);
  EXPECT_EQ(right("ann", kDesk), Right::kWrite);
  EXPECT_EQ(right("eve", kDesk), Right::kRead);
  grant(kAnn, kDesk, Right::kNone);
  EXPECT_EQ(right("ann", kDesk), Right::kNone) << "none, said of the client itself";
}

TEST_F(RightsTest, GroupsOfKeysCountBesideThoseOfRights) {
  grant(kCrew, kDesk, Right::kAdd);
  EXPECT_EQ(right("hand-9", kDesk), Right::kNone);
  rights_.set_groups_of_keys({{"hand-9", {"crew"}}, {"ann", {"crew", "night"}}});
  EXPECT_EQ(right("hand-9", kDesk), Right::kAdd);
  EXPECT_EQ(right("zoe", kDesk), Right::kNone);
  ASSERT_TRUE(rights_.let_create(kCrew, true));
  EXPECT_EQ(rights_.rule_on_creating("hand-9").right, Right::kWrite);
  EXPECT_THAT(rights_.memberships("hand-9"), testing::ElementsAre(Membership{"crew", false, true}));
  EXPECT_THAT(rights_.memberships("ann"), testing::Contains(Membership{"crew", true, true}));
  EXPECT_TRUE(rights_.groups().contains("night"));
  EXPECT_FALSE(rights_.table().groups.contains("night")) << "they are not kept with the rights";
  rights_.set_groups_of_keys({});
  EXPECT_EQ(right("hand-9", kDesk), Right::kNone) << "other keys";
}

TEST_F(RightsTest, WhatHasExpiredIsAsIfItWereNotThere) {
  grant(kCrew, {}, Right::kRead);
  grant(kAnn, kDesk, Right::kWrite, kLater);
  EXPECT_EQ(right("ann", kDesk), Right::kWrite);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).expires, kLater);
  EXPECT_EQ(right("ann", kDesk, kLater), Right::kRead);
  EXPECT_EQ(rights_.next_expiry(kNow), kLater);
  EXPECT_EQ(rights_.next_expiry(kLater), std::nullopt);
  ASSERT_TRUE(rights_.revoke(kCrew, {}));
  EXPECT_EQ(right("ann", kDesk, kLater), Right::kNone);
  EXPECT_THAT(rights_.rule("ann", kDesk, kLater).reason, HasSubstr("has expired"));
}

TEST_F(RightsTest, AFrozenMapIsReadByWhoMayAndTakesNothing) {
  grant(kAnn, {}, Right::kManage);
  ASSERT_TRUE(rights_.freeze(kDesk, Closure{"ops", kNow, "the exhibition is open"}));
  EXPECT_EQ(right("ann", kDesk), Right::kRead);
  EXPECT_EQ(right("ann", kBench), Right::kManage);
  EXPECT_EQ(right("zoe", kDesk), Right::kNone);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason, "the map is frozen by ops: the exhibition is open");
  ASSERT_TRUE(rights_.freeze(kDesk, {}));
  EXPECT_EQ(right("ann", kDesk), Right::kManage);
}

TEST_F(RightsTest, ABlockedClientMayNothing) {
  grant(kAnn, kDesk, Right::kManage);
  rights_.set_standard(Right::kWrite, true);
  ASSERT_TRUE(rights_.block("ann", Closure{"ops", kNow, ""}));
  EXPECT_EQ(right("ann", kDesk), Right::kNone);
  EXPECT_EQ(right("ann", kBench), Right::kNone);
  EXPECT_EQ(rights_.rule_on_creating("ann").right, Right::kNone);
  ASSERT_TRUE(rights_.block("ann", {}));
  EXPECT_EQ(right("ann", kDesk), Right::kManage);
}

TEST_F(RightsTest, MapsAreMadeByWhomIsNamedMostClosely) {
  const auto may = [&](const char* client) {
    return rights_.rule_on_creating(client).right == Right::kWrite;
  };
  const auto why = [&](const char* client) { return rights_.rule_on_creating(client).reason; };
  EXPECT_FALSE(may("ann"));
  EXPECT_EQ(why("ann"), "nobody at this site may make maps");
  ASSERT_TRUE(rights_.let_create({Subject::Kind::kClient, "bob"}, true));
  EXPECT_EQ(why("bob"), "client bob may make maps");
  EXPECT_EQ(why("ann"), "at this site only those may make maps whom an operator has named");
  ASSERT_TRUE(rights_.let_create(kEveryone, true));
  EXPECT_TRUE(may("zoe"));
  ASSERT_TRUE(rights_.let_create(kGuests, false));
  EXPECT_FALSE(may("eve"));
  ASSERT_TRUE(rights_.let_create(kCrew, true));
  EXPECT_TRUE(may("ann")) << "one of its groups may";
  ASSERT_TRUE(rights_.let_create(kAnn, false));
  EXPECT_FALSE(may("ann"));
  ASSERT_TRUE(rights_.let_create(kAnn, {}));
  EXPECT_TRUE(may("ann"));
}

TEST_F(RightsTest, AReasonIsASentenceThatSaysWhoMayDoWhatAndWhoSaidSo) {
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason, "ann may do nothing here, as everyone at this site");
  grant(kCrew, kDesk, Right::kRead);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason,
            "ann may only read here, as granted to group crew by ops");
  grant(kAnn, kDesk, Right::kAdd);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason, "ann may only read and add here, as granted by ops");
}

TEST_F(RightsTest, AnExtentGoesWithItsGrant) {
  const Extent extent = Sphere{{0, 0, 0}, 2};
  grant(kAnn, kDesk, Right::kWrite, {}, extent);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).extent, extent);
  EXPECT_EQ(rights_.rule("ann", kDesk, kNow).reason,
            "ann may write here, within 2.00 around 0.00 0.00 0.00, as granted by ops");
  grant(kCrew, kBench, Right::kWrite);
  grant(kGuests, kBench, Right::kWrite, {}, extent);
  EXPECT_EQ(rights_.rule("ann", kBench, kNow).extent, std::nullopt)
      << "of two that write, the one that may more";
}

TEST_F(RightsTest, WhatCannotBeIsRefusedByName) {
  const auto refusal = [&](Grant grant) {
    const Status taken = rights_.grant(std::move(grant));
    return taken ? std::string("taken") : taken.error().message;
  };
  EXPECT_THAT(refusal({{Kind::kClient, "Ann!"}, {}, Right::kRead, {}, {}, "ops", kNow}), HasSubstr("'Ann!'"));
  EXPECT_THAT(refusal({kAnn, kDesk, Right::kRead, Sphere{{0, 0, 0}, 1}, {}, "ops", kNow}),
              HasSubstr("only 'add' and 'write'"));
  EXPECT_THAT(refusal({kAnn, {}, Right::kWrite, Sphere{{0, 0, 0}, 1}, {}, "ops", kNow}),
              HasSubstr("name the map"));
  EXPECT_THAT(refusal({kAnn, kDesk, Right::kWrite, Sphere{{0, 0, 0}, -1}, {}, "ops", kNow}),
              HasSubstr("radius"));
  EXPECT_THAT(rights_.freeze(kDesk, Closure{"ops", kNow, "two\nlines"}).error().message,
              HasSubstr("the reason"));
  EXPECT_EQ(rights_.revoke(kAnn, kDesk).error().code, ErrorCode::kNotFound);
  EXPECT_THAT(parse_right("wrote").error().message, HasSubstr("did you mean write?"));
  EXPECT_FALSE(parse_subject("group "));
}

TEST_F(RightsTest, WordsOfSubjectsAndRightsAreReadBack) {
  for (const Subject& subject : {kEveryone, kAnn, kCrew})
    EXPECT_EQ(*parse_subject(to_string(subject)), subject);
  EXPECT_EQ(*parse_subject("ann"), kAnn);
  for (const Right right : {Right::kNone, Right::kRead, Right::kAdd, Right::kWrite, Right::kManage})
    EXPECT_EQ(*parse_right(to_string(right)), right);
}

TEST_F(RightsTest, AForgottenMapLeavesNoGrantBehind) {
  grant(kAnn, kDesk, Right::kManage);
  grant(kAnn, kBench, Right::kRead);
  ASSERT_TRUE(rights_.freeze(kDesk, Closure{"ops", kNow, ""}));
  rights_.forget(kDesk);
  EXPECT_EQ(right("ann", kDesk), Right::kNone);
  EXPECT_EQ(right("ann", kBench), Right::kRead);
  EXPECT_EQ(rights_.table().grants.size(), 1U);
  EXPECT_TRUE(rights_.table().frozen.empty());
}

/// Of whatever is granted, exactly one rule decides, and it says what rule() says.
TEST_F(RightsTest, AnExplanationNamesTheRuleThatDecides) {
  grant(kEveryone, {}, Right::kRead);
  grant(kCrew, kDesk, Right::kWrite);
  grant(kAnn, kDesk, Right::kManage, kNow);
  const auto seen = rights_.explain("ann", kDesk, kNow);
  ASSERT_EQ(seen.size(), 4U);
  EXPECT_EQ(seen[0].rule,
            "client ann, this map: manage until "
            "2027-01-15T08:00:00Z");
  EXPECT_EQ(seen[0].part, Part::kExpired);
  EXPECT_EQ(seen[1].rule, "group crew, this map: write");
  EXPECT_EQ(seen[1].part, Part::kDecides);
  EXPECT_EQ(seen[2].part, Part::kOutweighed);
  EXPECT_EQ(seen[3].rule, "everyone, by default: none");
  EXPECT_EQ(seen[3].part, Part::kOutweighed);
  ASSERT_TRUE(rights_.freeze(kDesk, Closure{"ops", kNow, ""}));
  EXPECT_EQ(rights_.explain("ann", kDesk, kNow)[0].part, Part::kDecides) << "the freeze";
  const auto of_reader = rights_.explain("ben", kDesk, kNow);
  EXPECT_EQ(of_reader[0].part, Part::kDecides);
  EXPECT_EQ(of_reader[0].rule, "everyone, all maps: read") << "a freeze takes nothing from who only reads";
}

TEST(RightsPolicyTest, AnOperatorMayAskForWhatItsRoleAllows) {
  const RightsPolicy policy(Rights(Right::kNone, false), [] { return kNow; });
  const auto most_of = [&](Duty duty) {
    std::vector<bool> may;
    for (const OperatorAct act :
         {OperatorAct::kSee, OperatorAct::kChange, OperatorAct::kTransfer, OperatorAct::kGovern})
      may.push_back(
          policy.may_ask(operator_principal("ann", Principal::Proof::kProven, duty), act).has_value());
    return may;
  };
  EXPECT_EQ(most_of(Duty::kWatch), (std::vector{true, false, false, false}));
  EXPECT_EQ(most_of(Duty::kCurate), (std::vector{true, true, true, false}));
  EXPECT_EQ(most_of(Duty::kAdminister), (std::vector{true, true, true, true}));
  EXPECT_TRUE(policy.may_ask(operator_principal("ann", Principal::Proof::kClaimed, Duty::kAdminister),
                             OperatorAct::kGovern));
  EXPECT_FALSE(policy.may_ask(Principal{Principal::Kind::kOperator, "ann"}, OperatorAct::kChange))
      << "of whom nothing is said, may watch";
  EXPECT_EQ(
      policy.may_ask(operator_principal("ann", Principal::Proof::kProven, Duty::kWatch), OperatorAct::kChange)
          .error()
          .message,
      "operator ann has the role watch; this needs the role curate");
}

TEST(RightsPolicyTest, ProposalsAreOfWhoMayReadWhereTheyAreWelcome) {
  RightsPolicy policy(Rights(Right::kNone, false), [] { return kNow; });
  const auto change = [&](auto make) {
    Rights rights = policy.rights();
    make(&rights);
    policy.put(rights);
  };
  const Principal ann = client_principal("ann");
  const Principal zoe = client_principal("zoe");
  change([](Rights* r) { EXPECT_TRUE(r->grant({kAnn, {}, Right::kRead, {}, {}, "ops", kNow})); });
  EXPECT_FALSE(policy.may_propose(ann, kDesk)) << "off by default";
  change([](Rights* r) { r->welcome_proposals(kDesk, true); });
  EXPECT_TRUE(policy.may_propose(ann, kDesk));
  EXPECT_FALSE(policy.may_propose(ann, kBench));
  EXPECT_FALSE(policy.may_propose(zoe, kDesk)) << "who may not read";
  change([](Rights* r) { r->welcome_proposals({}, true); });
  EXPECT_TRUE(policy.may_propose(ann, kBench));
  change([](Rights* r) { r->welcome_proposals(kBench, false); });
  EXPECT_FALSE(policy.may_propose(ann, kBench)) << "what is said of the map counts";
  change([](Rights* r) { EXPECT_TRUE(r->freeze(kDesk, Closure{"ops", kNow, "it opens"})); });
  EXPECT_TRUE(policy.may_propose(ann, kDesk));
  EXPECT_EQ(policy.why_frozen(kDesk), "the map is frozen by ops: it opens");
  EXPECT_EQ(policy.why_frozen(kBench), "");
  change([](Rights* r) { EXPECT_TRUE(r->block("ann", Closure{"ops", kNow, ""})); });
  EXPECT_FALSE(policy.may_propose(ann, kDesk));
}

}  // namespace
}  // namespace cairn
