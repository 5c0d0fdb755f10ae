// SPDX-License-Identifier: Apache-2.0
#include "server/service/wearer_rule.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "common/io/test_directory.h"
#include "server/service/wearer_list.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr MapId kDesk{{1}};
constexpr MapId kBench{{2}};
constexpr MapId kRobot{{3}};

PlaceCandidate place(const MapId& map, int inliers, bool confirmed = true) {
  PlaceCandidate candidate;
  candidate.map = map;
  candidate.inliers = inliers;
  candidate.confirmed = confirmed;
  return candidate;
}

RelocalizationAnswer answer(std::vector<PlaceCandidate> candidates) {
  RelocalizationAnswer made;
  made.candidates = std::move(candidates);
  if (!made.candidates.empty() && made.candidates.front().confirmed)
    made.verdict = RelocalizationVerdict::kConfirmed;
  return made;
}

std::vector<MapId> maps_in(const RelocalizationAnswer& answer) {
  std::vector<MapId> maps;
  for (const PlaceCandidate& candidate : answer.candidates) maps.push_back(candidate.map);
  return maps;
}

class WearerRuleTest : public ::testing::Test {
 protected:
  void see(const std::string& client, const std::string& wearer, const MapId& verified_in) {
    rule_.heard(client, {wearer, verified_in, Timestamp{++frame_}}, now_);
  }
  /// Anna's shoulder camera is tracked; the one in her hand asks.
  void wear(const MapId& verified_in = kDesk) {
    see("shoulder", "anna", verified_in);
    see("hand", "anna", {});
  }
  RelocalizationAnswer told(RelocalizationAnswer found, const std::string& client = "hand") {
    const bool in_part = rule_.search(client, findable_, now_).in_part;
    return rule_.narrow(client, findable_, in_part, std::move(found), now_);
  }
  std::vector<MapId> first(const std::string& client) const {
    return rule_.search(client, findable_, now_).scope.first;
  }
  void use(WearerOptions options) { rule_ = WearerRule(std::move(options)); }

  WearerRule rule_{{}};
  MapSet findable_ = MapSet::all();
  MonotonicTime now_{1h};
  int64_t frame_ = 0;
};

TEST_F(WearerRuleTest, TheMapOfAWearersOtherCameraIsSearchedFirst) {
  wear();
  EXPECT_THAT(first("hand"), ElementsAre(kDesk));
  EXPECT_EQ(rule_.search("hand", findable_, now_).scope.maps, MapSet::all());
  EXPECT_THAT(first("shoulder"), IsEmpty()) << "its own map says nothing new";
  see("head", "anna", kBench);
  EXPECT_THAT(first("hand"), ElementsAre(kDesk, kBench));
  see("head", "anna", kDesk);
  EXPECT_THAT(first("hand"), ElementsAre(kDesk)) << "each once";
}

TEST_F(WearerRuleTest, OthersAndWhoIsNobodysAreNotNarrowed) {
  wear();
  see("visitor", "bob", {});
  see("stray", "", {});
  see("other-stray", "", kDesk);
  for (const char* client : {"visitor", "stray", "never-heard-of"}) {
    EXPECT_THAT(first(client), IsEmpty()) << client;
    EXPECT_THAT(maps_in(told(answer({place(kBench, 50)}), client)), ElementsAre(kBench)) << client;
  }
}

TEST_F(WearerRuleTest, AVerificationCountsForHalfASecondAndOnlyWithANewImage) {
  wear();
  now_ += WearerRule::kFresh;
  EXPECT_THAT(first("hand"), ElementsAre(kDesk));
  rule_.heard("shoulder", {"anna", kDesk, Timestamp{1}}, now_);  // the image of half a second ago
  now_ += 1ms;
  EXPECT_THAT(first("hand"), IsEmpty()) << "its camera stands still, or is gone";
  see("shoulder", "anna", kDesk);
  see("shoulder", "anna", {});
  EXPECT_THAT(first("hand"), ElementsAre(kDesk)) << "just lost: still the place";
  rule_.left("shoulder");
  EXPECT_THAT(first("hand"), IsEmpty());
}

TEST_F(WearerRuleTest, AConfirmedPlaceInThatMapHidesLookAlikes) {
  wear();
  const RelocalizationAnswer said =
      told(answer({place(kBench, 70), place(kDesk, 40), place(kRobot, 9, false)}));
  EXPECT_EQ(said.verdict, RelocalizationVerdict::kConfirmed);
  EXPECT_THAT(maps_in(said), ElementsAre(kDesk));
}

TEST_F(WearerRuleTest, ClearlyMoreInliersInAnotherMapOverruleIt) {
  wear();
  const auto at_least = static_cast<int>(40 * WearerRule::kClearlyMore);
  EXPECT_THAT(maps_in(told(answer({place(kBench, at_least), place(kDesk, 40)}))), ElementsAre(kDesk));
  EXPECT_THAT(maps_in(told(answer({place(kBench, at_least + 1), place(kDesk, 40)}))),
              ElementsAre(kBench, kDesk));
  EXPECT_THAT(maps_in(told(answer({place(kDesk, 40), place(kBench, 500, false)}))), ElementsAre(kDesk))
      << "what is not confirmed is no evidence";
}

TEST_F(WearerRuleTest, NotConfirmedThereInTwoQueriesInARowAllMapsCount) {
  wear();
  const auto elsewhere = [] { return answer({place(kBench, 45), place(kDesk, 25, false)}); };
  for (int round = 0; round < 2; ++round) {
    const RelocalizationAnswer first = told(elsewhere());
    EXPECT_EQ(first.verdict, RelocalizationVerdict::kNotThere) << "others may know it";
    EXPECT_THAT(maps_in(first), ElementsAre(kDesk));
    EXPECT_FALSE(first.reason.empty());
    for (int more = 0; more < 3; ++more) {
      EXPECT_THAT(maps_in(told(elsewhere())), ElementsAre(kBench, kDesk)) << "from the second on";
    }
    EXPECT_THAT(maps_in(told(answer({place(kDesk, 30), place(kBench, 45)}))), ElementsAre(kDesk));
  }
}

TEST_F(WearerRuleTest, TheCountBeginsAnewWithEachLoss) {
  wear();
  const RelocalizationAnswer elsewhere = answer({place(kBench, 50), place(kDesk, 40, false)});
  EXPECT_THAT(maps_in(told(elsewhere)), ElementsAre(kDesk));
  EXPECT_THAT(maps_in(told(elsewhere)), ElementsAre(kBench, kDesk));
  see("hand", "anna", kBench);
  see("hand", "anna", {});
  EXPECT_THAT(maps_in(told(elsewhere)), ElementsAre(kDesk));
}

TEST_F(WearerRuleTest, TheCountBeginsAnewWithTheMapOfTheOther) {
  wear();
  (void)told(answer({place(kBench, 45), place(kDesk, 25, false)}));
  see("shoulder", "anna", kRobot);
  const auto elsewhere = [] { return answer({place(kBench, 45), place(kRobot, 25, false)}); };
  EXPECT_EQ(told(elsewhere()).verdict, RelocalizationVerdict::kNotThere);
  EXPECT_EQ(told(elsewhere()).verdict, RelocalizationVerdict::kConfirmed);
}

TEST_F(WearerRuleTest, NotKnownAnywhereIsSaidAtOnce) {
  wear();
  EXPECT_EQ(told(answer({place(kDesk, 10, false), place(kBench, 9, false)})).verdict,
            RelocalizationVerdict::kNotKnown);
  EXPECT_EQ(told(answer({})).verdict, RelocalizationVerdict::kNotKnown);
}

TEST_F(WearerRuleTest, TheFirstToRecoverNarrowsAnswersThatAreOnTheirWay) {
  see("shoulder", "anna", {});
  see("hand", "anna", {});
  EXPECT_THAT(first("hand"), IsEmpty());
  EXPECT_THAT(maps_in(told(answer({place(kBench, 50), place(kDesk, 40)}))), ElementsAre(kBench, kDesk));
  see("shoulder", "anna", kDesk);
  EXPECT_THAT(maps_in(told(answer({place(kBench, 50), place(kDesk, 40)}))), ElementsAre(kDesk));
}

TEST_F(WearerRuleTest, ThePapersRuleNeverLooksElsewhere) {
  use({WearerPolicy::kOnly, {}});
  see("hand", "anna", {});
  EXPECT_THAT(first("hand"), IsEmpty());
  EXPECT_EQ(rule_.search("hand", findable_, now_).scope.maps, MapSet::all()) << "with all cameras lost";
  wear();
  const WearerRule::Search asked = rule_.search("hand", findable_, now_);
  EXPECT_EQ(asked.scope.maps, MapSet({kDesk}));
  EXPECT_TRUE(asked.in_part);
  for (int query = 0; query < 5; ++query) {
    EXPECT_EQ(told(answer({place(kDesk, 25, false)})).verdict, RelocalizationVerdict::kNotThere);
    EXPECT_THAT(maps_in(told(answer({place(kBench, 900), place(kDesk, 40)}))), ElementsAre(kDesk));
  }
  now_ += WearerRule::kFresh + 1ms;
  EXPECT_EQ(rule_.narrow("hand", findable_, asked.in_part, answer({place(kDesk, 25, false)}), now_).verdict,
            RelocalizationVerdict::kNotThere)
      << "only a part was searched";
  EXPECT_EQ(told(answer({place(kBench, 25, false)})).verdict, RelocalizationVerdict::kNotKnown);
}

TEST_F(WearerRuleTest, AMapThatAClientMayNotFindItselfInNarrowsNothing) {
  for (const WearerPolicy policy : {WearerPolicy::kFirst, WearerPolicy::kOnly}) {
    use({policy, {}});
    wear(kRobot);
    findable_ = MapSet({kDesk, kBench});
    const WearerRule::Search search = rule_.search("hand", findable_, now_);
    EXPECT_THAT(search.scope.first, IsEmpty()) << "the order would tell where the other camera is";
    EXPECT_EQ(search.scope.maps, findable_);
    EXPECT_FALSE(search.in_part);
    EXPECT_THAT(maps_in(told(answer({place(kBench, 50)}))), ElementsAre(kBench));
    see("shoulder", "anna", kDesk);
    EXPECT_THAT(maps_in(told(answer({place(kBench, 50), place(kDesk, 40)}))), ElementsAre(kDesk));
  }
}

TEST_F(WearerRuleTest, AGuessOfThePapersMethodIsLeftAsItIs) {
  wear();
  RelocalizationAnswer guess = answer({place(kBench, 0, false)});
  guess.verdict = RelocalizationVerdict::kUnconfirmed;
  const RelocalizationAnswer said = told(guess);
  EXPECT_EQ(said.verdict, RelocalizationVerdict::kUnconfirmed);
  EXPECT_THAT(maps_in(said), ElementsAre(kBench));
}

TEST_F(WearerRuleTest, WhereTheOperatorHasRegisteredClaimsDoNotCount) {
  use({WearerPolicy::kFirst, WearerList{{"hand", "anna"}, {"shoulder", "anna"}}});
  see("shoulder", "", kDesk);
  see("hand", "", {});
  see("spy", "anna", {});
  EXPECT_THAT(first("hand"), ElementsAre(kDesk));
  EXPECT_THAT(first("spy"), IsEmpty());
  EXPECT_EQ(rule_.wearer_of("hand"), "anna");
  EXPECT_EQ(rule_.wearer_of("spy"), "");
}

class WearerListTest : public ::testing::Test {
 protected:
  Result<WearerList> read(const std::string& text) const {
    std::ofstream(path_) << text;
    return read_wearers(path_);
  }
  TestDirectory directory_;
  const std::filesystem::path path_ = directory_.path() / "cairn-wearers.yaml";
};

TEST_F(WearerListTest, EachClientHasItsWearer) {
  const auto list = read("anna: [hand-1, shoulder-1]\nbob: [hand-2]\n");
  ASSERT_TRUE(list) << list.error().message;
  EXPECT_EQ(*list, (WearerList{{"hand-1", "anna"}, {"shoulder-1", "anna"}, {"hand-2", "bob"}}));
  EXPECT_TRUE(read("")->empty());
  EXPECT_EQ(*read("\xef\xbb\xbf"
                  "anna: [hand-1]\rbob: [hand-2]\r"),
            (WearerList{{"hand-1", "anna"}, {"hand-2", "bob"}}));
  EXPECT_THAT(read(std::string("\xff\xfe\x61\0", 4)).error().message, HasSubstr("is UTF-16 text"));
}

TEST_F(WearerListTest, AMistakeIsToldWithItsLine) {
  struct Case {
    std::string text;
    std::string line;
    std::string why;
  };
  for (const Case& c : std::vector<Case>{{"a: [x]\nb: [y, x]\n", ":2:", "'x' is worn by a already"},
                                         {"a: x\n", ":1:", "expected"},
                                         {"- a\n", ":1:", "expected"},
                                         {"a: [x]\nB b: [y]\n", ":2:", "'B b'"},
                                         {"a: [x, 'No Name']\n", ":1:", "a-z"},
                                         {"a: [x, [y]]\n", ":1:", "a-z"},
                                         {"a: [", "", "cairn-wearers"}}) {
    const auto list = read(c.text);
    ASSERT_FALSE(list) << c.text;
    EXPECT_EQ(list.error().code, ErrorCode::kConfiguration);
    EXPECT_THAT(list.error().message, ::testing::AllOf(HasSubstr(c.line), HasSubstr(c.why)));
  }
  EXPECT_THAT(read_wearers("/nowhere.yaml").error().message, HasSubstr("cannot be read"));
}

}  // namespace
}  // namespace cairn
