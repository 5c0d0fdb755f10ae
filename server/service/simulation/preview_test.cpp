// SPDX-License-Identifier: Apache-2.0
//
// What an operator is shown of a proposal when the map has entered another epoch since.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class Preview : public LoneClientFixture {
 protected:
  json done(const json& request) {
    EXPECT_EQ(ask(request.dump()), "") << request.dump();
    return reply_ && reply_->result == 0 ? json::parse(reply_->text) : json();
  }
  /// Kept aside, with its pose relative to a keyframe.
  void propose(int step, KeyframeId reference) {
    wire::KeyframeOffer offer = sound_offer(step);
    const SE3 pose = offer.camera_from_reference * snapshot_->find(offer.reference)->camera_from_map;
    offer.reference = reference;
    offer.camera_from_reference = pose * snapshot_->find(reference)->camera_from_map.inverse();
    offer.as_proposal = true;
    EXPECT_THAT(judge(offer), HasSubstr("kept aside"));
  }
};

TEST_F(Preview, AKeyframeThatIsAnotherNowIsNotTakenForTheOneThatItWasTakenBeside) {
  done({{"verb", "proposals-welcome"}, {"map", "desk"}, {"welcome", true}});
  done({{"verb", "tag"}, {"map", "desk"}, {"tag", "bare"}});
  ASSERT_EQ(judge(sound_offer(5)), "");
  ASSERT_NE(snapshot_->find(KeyframeId{3}), nullptr);
  propose(9, KeyframeId{3});
  propose(13, KeyframeId{2});
  done({{"verb", "roll-back"}, {"map", "desk"}, {"tag", "bare"}});
  ASSERT_EQ(judge(sound_offer(12)), "");
  ASSERT_NE(snapshot_->find(KeyframeId{3}), nullptr) << "the number has been given again";
  const json waiting = done({{"verb", "proposals"}})["proposals"];
  ASSERT_EQ(waiting.size(), 2U);
  const json gone = done({{"verb", "proposal-show"}, {"proposal", waiting[0]["id"]}});
  EXPECT_THAT(gone.value("problem", ""), HasSubstr("is in the map no more"));
  EXPECT_FALSE(gone.contains("points"));
  const json stays = done({{"verb", "proposal-show"}, {"proposal", waiting[1]["id"]}});
  EXPECT_FALSE(stays.contains("problem")) << stays;
  EXPECT_GT(stays.value("found_now", 0), 20);
}

}  // namespace
}  // namespace cairn::simulation
