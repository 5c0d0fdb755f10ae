// SPDX-License-Identifier: Apache-2.0
//
// What clients have offered and nothing has judged yet takes so much memory and no more, whatever it is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using ::testing::HasSubstr;

class TooMuchWaits : public LoneClientFixture {
 protected:
  void SetUp() override {
    LoneClientFixture::SetUp();
    EXPECT_EQ(ask(R"({"verb": "proposals-welcome", "map": "desk", "welcome": true})"), "");
    adjust_ = [](MapServiceOptions& options) { options.max_waiting_bytes = 1; };
    begin_again();
  }
  static constexpr const char* kWhy = "too much waits to be judged";
};

TEST_F(TooMuchWaits, NoKeyframeIsTaken) {
  EXPECT_THAT(judge(sound_offer(6)), HasSubstr(kWhy));
}

TEST_F(TooMuchWaits, NoMapIsBegun) {
  EXPECT_THAT(judge(views_.seed()), HasSubstr(kWhy));
}

TEST_F(TooMuchWaits, NoProposalIsLookedAt) {
  wire::KeyframeOffer offer = sound_offer(6);
  offer.as_proposal = true;
  EXPECT_THAT(judge(offer), HasSubstr(kWhy));
}

}  // namespace
}  // namespace cairn::simulation
