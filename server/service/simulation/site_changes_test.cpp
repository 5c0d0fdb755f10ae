// SPDX-License-Identifier: Apache-2.0
//
// Who may do what changes at once, whatever else operators have going on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

/// While a large archive is made and a backup waits for it.
class SiteChanges : public LoneClientFixture {
 protected:
  void SetUp() override {
    LoneClientFixture::SetUp();
    server_->let_store_strand_take_long(true);
    ASSERT_EQ(ask({{"verb", "export"}, {"map", "desk"}}), "nothing is said of it");
    ASSERT_EQ(ask({{"verb", "backup"}}), "nothing is said of it");
  }
  /// By another run of cairnctl than those that wait.
  std::string ask(const json& request) {
    ++operator_session_.value;
    return LoneClientFixture::ask(request.dump());
  }
};

TEST_F(SiteChanges, WhatIsRevokedIsGoneAndWhatIsGrantedIsThere) {
  EXPECT_EQ(ask({{"verb", "rights-grant"}, {"to", "client anna"}, {"map", "desk"}, {"right", "none"}}), "");
  EXPECT_FALSE(server_->service().maps().follow(client_principal(kClient), map_));
  EXPECT_THAT(judge(sound_offer(6)), HasSubstr("does not know the map"));
  EXPECT_EQ(ask({{"verb", "rights-grant"}, {"to", "client anna"}, {"map", "desk"}, {"right", "write"}}), "");
  EXPECT_EQ(judge(sound_offer(6)), "");
}

TEST_F(SiteChanges, TheAuditLogIsThereToo) {
  EXPECT_EQ(ask({{"verb", "client-block"}, {"client", "ben"}}), "");
  ASSERT_EQ(ask({{"verb", "audit"}}), "");
  EXPECT_EQ(json::parse(reply_->text)["entries"][0]["action"], "client block") << reply_->text;
}

}  // namespace
}  // namespace cairn::simulation
