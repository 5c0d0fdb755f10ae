// SPDX-License-Identifier: Apache-2.0
//
// A second process under a client's name, which floods the server: what it sends is not counted as the
// client's.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/service/simulation/lone_client_fixture.h"

namespace cairn::simulation {
namespace {

class Intruder : public LoneClientFixture {
 protected:
  static constexpr int kFlood = 10'000;  ///< far more at once than is looked at

  [[nodiscard]] wire::TrackerStateMessage state_of(SessionId session) const {
    wire::TrackerStateMessage state;
    state.client = id_;
    state.session = session;
    return state;
  }
  bool hears(const wire::TrackerStateMessage& state, wire::PublicationHandle publication,
             wire::PeerId process) {
    return server_->service().sessions().hear(client_principal(kClient), publication, process, state);
  }
  void flood_with_states() {
    speak();
    for (int i = 0; i < kFlood; ++i)
      EXPECT_FALSE(hears(state_of(SessionId{66}), wire::PublicationHandle{8}, other_process_));
  }
  void announce(wire::PeerId process, uint32_t number) {
    wire::CameraMessage camera;
    camera.client = id_;
    camera.camera = number;
    camera.parameters = views_.camera()->parameters();
    server_->service().sessions().announce(client_principal(kClient), process, camera);
  }
  void flood_with_cameras() {
    for (int i = 0; i < kFlood; ++i) announce(other_process_, 0);
  }

  const wire::PeerId other_process_{{9, 9, 9}};
};

TEST_F(Intruder, ItsStatesUseUpNothingOfTheHolders) {
  flood_with_states();
  EXPECT_TRUE(hears(state_of(session_), publication_, process_));
}

TEST_F(Intruder, NorOfAHolderThatHasMatchedAnew) {
  flood_with_states();
  EXPECT_TRUE(hears(state_of(session_), wire::PublicationHandle{9}, process_));
}

TEST_F(Intruder, NorDoItsCameras) {
  flood_with_cameras();
  announce(process_, 5);
  wire::KeyframeOffer offer = sound_offer(6);
  offer.camera = 5;
  EXPECT_EQ(judge(offer), "");
}

TEST_F(Intruder, NorOfATrackerThatStartsAnewDuringThem) {
  flood_with_cameras();
  const wire::PeerId anew{{4, 5, 6}};
  announce(anew, 5);
  EXPECT_TRUE(hears(state_of(session_), publication_, anew));
  wire::KeyframeOffer offer = sound_offer(6);
  offer.camera = 5;
  offer.client = id_;
  offer.command = {session_, next_offer_};
  server_->service().take(client_principal(kClient), offer);
  settle();
  EXPECT_EQ(reason_of(offer), "");
}

}  // namespace
}  // namespace cairn::simulation
