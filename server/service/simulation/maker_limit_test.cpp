// SPDX-License-Identifier: Apache-2.0
//
// How many maps one client makes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class MakerLimit : public LoneClientFixture {
 protected:
  MakerLimit() {
    adjust_ = [](MapServiceOptions& options) { options.max_maps_per_client = 2; };
  }
  void ask_for(const json& request) { EXPECT_EQ(ask(request.dump()), ""); }
};

TEST_F(MakerLimit, AClientMakesSoManyMapsAlsoAfterARestartAndOnlyItsOwnThatAreThereCount) {
  ask_for({{"verb", "copy"}, {"map", "desk"}, {"name", "copied"}});
  EXPECT_EQ(judge(views_.seed()), "") << "the copy is an operator's";
  const std::string why = judge(views_.seed());
  EXPECT_THAT(why, HasSubstr("has made 2 of the maps here"));
  EXPECT_THAT(why, HasSubstr("--max-maps-per-client"));
  begin_again();
  EXPECT_EQ(judge(views_.seed()), why);
  ask_for({{"verb", "delete"}, {"map", "desk"}});
  EXPECT_EQ(judge(views_.seed()), "");
  EXPECT_THAT(judge(views_.seed()), HasSubstr("--max-maps-per-client"));
  ask_for({{"verb", "undelete"}, {"map", "desk"}});
  EXPECT_THAT(judge(views_.seed()), HasSubstr("has made 3 of the maps here"));
}

}  // namespace
}  // namespace cairn::simulation
