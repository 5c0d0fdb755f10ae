// SPDX-License-Identifier: Apache-2.0
//
// What a client has offered and loses the right to before it is decided: at whatever point of its way it is
// withdrawn, either its client had been told that it was taken, or nothing comes of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "server/service/simulation/lone_client_fixture.h"
#include "server/store/map_file.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr int kMostTasks = 200;
constexpr const char* kRollBack = R"({"verb": "roll-back", "map": "desk", "tag": "bare"})";

class Withdrawn : public LoneClientFixture {
 protected:
  /// So many tasks of the server, then the keys of its client are revoked.
  void revoke_after(int tasks) {
    for (int i = 0; i < tasks; ++i) (void)server_->run_something();
    server_->service().clients().turn_away({kClient});
  }
  [[nodiscard]] size_t maps() const { return server_->service().maps().all().size(); }
  /// Of the commands whose decisions are in the map's file.
  [[nodiscard]] size_t refusals_kept() const {
    const auto path = directory_.path() / "maps" / (to_hex(map_.bytes) + ".cairnmap");
    auto file = MapFile::open(path);
    EXPECT_TRUE(file);
    const StoredMap stored = file->load(LoadedImages::kNone);
    return static_cast<size_t>(std::ranges::count_if(stored.decisions, [](const DecisionRecord& d) {
      return d.decision == static_cast<uint8_t>(wire::OfferDecision::kNoRight);
    }));
  }
  [[nodiscard]] size_t proposals() {
    EXPECT_EQ(ask(R"({"verb": "proposals"})"), "");
    return json::parse(reply_->text)["proposals"].size();
  }
};

TEST_F(Withdrawn, ASeedMakesNoMapAtWhateverPointOfItsWay) {
  size_t expected = maps();
  bool was_told = false;
  int withdrawn = 0;
  for (int tasks = 0; !was_told && tasks < kMostTasks; ++tasks) {
    SCOPED_TRACE(std::to_string(tasks) + " tasks");
    wire::MapSeed seed = views_.seed();
    send(&seed);
    revoke_after(tasks);
    was_told = reason_of(seed) == "";
    settle();
    const auto reason = reason_of(seed);
    ASSERT_TRUE(reason.has_value());
    if (was_told) {
      ++expected;
    } else {
      ++withdrawn;
      EXPECT_THAT(*reason, HasSubstr("whether this client may make maps has changed"));
    }
    ASSERT_EQ(maps(), expected);
  }
  EXPECT_TRUE(was_told);
  EXPECT_GT(withdrawn, 3) << "in its queue, being kept, being told";
  begin_again();
  EXPECT_EQ(maps(), expected) << "nothing of it was left in the store";
}

TEST_F(Withdrawn, ASeedOfWhoMayMakeNoMapsAnyMoreMakesNone) {
  size_t expected = maps();
  bool was_withdrawn = false;
  for (int i = 0; !was_withdrawn && i < kMostTasks; ++i) {
    wire::MapSeed seed = views_.seed();
    send(&seed);
    ASSERT_EQ(ask(R"({"verb": "client-block", "client": "anna"})"), "");
    settle();
    const std::string reason = reason_of(seed).value_or("none");
    was_withdrawn = !reason.empty();  // else it was a map before that was in force
    expected += was_withdrawn ? 0 : 1;
    if (was_withdrawn) {
      EXPECT_THAT(reason, HasSubstr("whether this client may make maps has changed"));
    }
    ASSERT_EQ(maps(), expected);
    ASSERT_EQ(ask(R"({"verb": "client-unblock", "client": "anna"})"), "");
  }
  EXPECT_TRUE(was_withdrawn);
}

TEST_F(Withdrawn, AProposalIsNotKeptAtWhateverPointOfItsWay) {
  EXPECT_EQ(ask(R"({"verb": "proposals-welcome", "map": "desk", "welcome": true})"), "");
  const MapSnapshotPtr seen = snapshot_;
  bool was_told = false;
  int withdrawn = 0;
  for (int tasks = 0; !was_told && tasks < kMostTasks; ++tasks) {
    SCOPED_TRACE(std::to_string(tasks) + " tasks");
    wire::KeyframeOffer offer = views_.offer(*seen, 6).value();
    offer.as_proposal = true;
    send(&offer);
    revoke_after(tasks);
    was_told = reason_of(offer).has_value();
    settle();
    const auto reason = reason_of(offer);
    ASSERT_TRUE(reason.has_value());
    if (!was_told) {
      ++withdrawn;
      EXPECT_EQ(*reason, "no proposals are taken in this map");
    }
    ASSERT_EQ(proposals(), was_told ? 1U : 0U);
  }
  EXPECT_TRUE(was_told);
  EXPECT_GT(withdrawn, 3) << "being looked at, being kept, being told";
  begin_again();
  EXPECT_EQ(proposals(), 1U);
}

/// The map's file is another from when the roll-back begins, and the proposal may be in it already.
TEST_F(Withdrawn, NorInAMapThatIsBeingRolledBack) {
  EXPECT_EQ(ask(R"({"verb": "proposals-welcome", "map": "desk", "welcome": true})"), "");
  EXPECT_EQ(ask(R"({"verb": "tag", "map": "desk", "tag": "bare"})"), "");
  uint64_t kept = 0;  ///< since it was told before
  for (int tasks = 0; kept == 0 && tasks < kMostTasks; ++tasks) {
    SCOPED_TRACE(std::to_string(tasks) + " tasks");
    wire::KeyframeOffer offer = sound_offer(6);
    offer.as_proposal = true;
    send(&offer);
    server_->service().take(
        operator_principal(kOperator, Principal::Proof::kClaimed, Duty::kAdminister),
        {client_id_from_name(kOperator), {SessionId{++operator_session_.value}, ++asked_}, kRollBack, {}});
    revoke_after(tasks);
    if (reason_of(offer).value_or("").starts_with("kept aside")) kept = offer.command.seq;
    server_->let_store_strand_take_long(true);
    settle();
    server_->let_store_strand_take_long(false);
    settle();
    EXPECT_TRUE(reason_of(offer));
    ASSERT_EQ(proposals(), kept != 0 ? 1U : 0U);
  }
  server_->end();
  EXPECT_GT(refusals_kept(), 0U) << "what was in the store already; sent again, it is answered as before";
  begin();
  settle();
  EXPECT_EQ(proposals(), kept != 0 ? 1U : 0U) << "nothing else was left in the store";
  for (const wire::OfferOutcome& outcome : offers_.recent) {
    if (outcome.decision == wire::OfferDecision::kKeptAside) {
      EXPECT_EQ(outcome.seq, kept);
    }
  }
}

}  // namespace
}  // namespace cairn::simulation
