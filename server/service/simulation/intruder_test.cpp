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
  const wire::PublicationHandle other_publication_{8};
  const wire::PeerId other_process_{{9, 9, 9}};
};

TEST_F(Intruder, ItsStatesUseUpNothingOfTheHolders) {
  wire::TrackerStateMessage state;
  state.client = id_;
  state.session = SessionId{66};
  MapService& service = server_->service();
  speak();
  for (int i = 0; i < kFlood; ++i)
    EXPECT_FALSE(service.take(client_principal(kClient), other_publication_, other_process_, state));
  state.session = session_;
  EXPECT_TRUE(service.take(client_principal(kClient), publication_, process_, state));
}

TEST_F(Intruder, NorOfAHolderThatHasMatchedAnew) {
  wire::TrackerStateMessage state;
  state.client = id_;
  state.session = SessionId{66};
  MapService& service = server_->service();
  speak();
  for (int i = 0; i < kFlood; ++i)
    EXPECT_FALSE(service.take(client_principal(kClient), other_publication_, other_process_, state));
  state.session = session_;
  const wire::PublicationHandle again{9};
  EXPECT_TRUE(service.take(client_principal(kClient), again, process_, state));
}

TEST_F(Intruder, NorDoItsCameras) {
  wire::CameraMessage camera;
  camera.client = id_;
  camera.parameters = views_.camera()->parameters();
  MapService& service = server_->service();
  for (int i = 0; i < kFlood; ++i) service.take(client_principal(kClient), other_process_, camera);
  camera.camera = 5;
  service.take(client_principal(kClient), process_, camera);
  wire::KeyframeOffer offer = sound_offer(6);
  offer.camera = 5;
  EXPECT_EQ(judge(offer), "");
}

}  // namespace
}  // namespace cairn::simulation
