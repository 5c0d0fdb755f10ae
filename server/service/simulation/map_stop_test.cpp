// SPDX-License-Identifier: Apache-2.0
//
// A map is stopped for a roll-back, and for taking a contributor out, and no longer than that takes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

class MapStop : public LoneClientFixture {
 protected:
  void SetUp() override {
    LoneClientFixture::SetUp();
    ASSERT_EQ(ask(R"({"verb": "tag", "map": "desk", "tag": "bare"})"), "");
    // Somebody has a large archive made.
    server_->let_store_strand_take_long(true);
    ASSERT_EQ(ask(R"({"verb": "export", "map": "desk"})"), kNothing);
  }
  /// By another run of cairnctl than those before, which wait.
  std::string ask(const char* request) {
    ++operator_session_.value;
    return LoneClientFixture::ask(request);
  }
  [[nodiscard]] std::map<std::string, int> keyframes_of_tags() const {
    std::map<std::string, int> keyframes;
    const auto told = nlohmann::json::parse(reply_->text);
    for (const auto& tag : told["tags"]) keyframes[tag["tag"]] = tag["keyframes"];
    return keyframes;
  }
  static constexpr const char* kNothing = "nothing is said of it";
};

TEST_F(MapStop, AMapTakesKeyframesWhileItsRollBackWaitsForAnArchive) {
  ASSERT_EQ(ask(R"({"verb": "roll-back", "map": "desk", "tag": "bare"})"), kNothing);
  EXPECT_EQ(judge(sound_offer(6)), "");
  EXPECT_EQ(snapshot_->keyframe_count(), 3U);
  server_->let_store_strand_take_long(false);
  settle();
  ASSERT_TRUE(reply_);
  EXPECT_EQ(reply_->result, 0U) << reply_->text;
  EXPECT_EQ(snapshot_->keyframe_count(), 2U);
  ASSERT_EQ(ask(R"({"verb": "tags", "map": "desk"})"), "");
  EXPECT_THAT(keyframes_of_tags(), ElementsAre(Pair("bare", 2), Pair("before-rollback-1", 3)));
  EXPECT_EQ(judge(sound_offer(6)), "");
}

TEST_F(MapStop, ARollBackOfAMapThatHasBeenDeletedMeanwhileIsRefused) {
  ASSERT_EQ(ask(R"({"verb": "roll-back", "map": "desk", "tag": "bare"})"), kNothing);
  ASSERT_EQ(ask(R"({"verb": "delete", "map": "desk"})"), kNothing);
  server_->let_store_strand_take_long(false);
  settle();
  EXPECT_EQ(ask(R"({"verb": "undelete", "map": "desk"})"), "");
  EXPECT_EQ(ask(R"({"verb": "roll-back", "map": "desk", "tag": "bare"})"), "") << "the way is free again";
}

TEST_F(MapStop, AContributorThatIsNoneStopsNoMap) {
  EXPECT_THAT(ask(R"({"verb": "drop-contributor", "map": "desk", "client": "anno"})"),
              HasSubstr("client 'anno' has no keyframe in map desk"));
  EXPECT_EQ(judge(sound_offer(6)), "");
  ASSERT_EQ(ask(R"({"verb": "drop-contributor", "map": "desk", "client": "anna"})"), kNothing);
  server_->let_store_strand_take_long(false);
  settle();
  ASSERT_TRUE(reply_);
  EXPECT_THAT(reply_->text, HasSubstr("nothing would be left of map desk"));
}

}  // namespace
}  // namespace cairn::simulation
