// SPDX-License-Identifier: Apache-2.0
// The service against clients that repeat themselves, are impatient or lie: written on the wire itself.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>

#include "client/session/label_request.h"
#include "tests/integration/raw_client.h"
#include "tests/integration/test_domain.h"

namespace cairn {
namespace {

using testing::eventually;
using ::testing::HasSubstr;
using testing::RawClient;
using testing::value_of;

class ProtocolTest : public ::testing::Test {
 protected:
  explicit ProtocolTest(const ServiceOptions& options = {})
      : options_(options),
        service_(testing::start_service(&options_)),
        client_(options_.domain, "anna", scene_.camera()) {}

  wire::MapSeed make_seed(uint64_t seq) {
    wire::MapSeed seed = testing::seed_of(client_, seq, scene_);
    seed.lockstep = true;
    seed.map_name = "desk";
    return seed;
  }
  wire::KeyframeOffer make_offer(uint64_t seq, int step) {
    wire::KeyframeOffer offer = testing::offer_of(client_, seq, scene_, *service_->maps().at(0), step);
    offer.lockstep = true;
    return offer;
  }
  /// Writes the same seed until there is a verdict on it.
  [[nodiscard]] bool seed_until_decided(const wire::MapSeed& seed) {
    return eventually([&] {
      client_.spin();
      if (client_.seed_verdict && client_.seed_verdict->command == seed.command) return true;
      (void)client_.seeds.write(seed);
      return false;
    });
  }
  [[nodiscard]] bool wait_decided(uint64_t seq) {
    return eventually([&] {
      client_.spin();
      return client_.offer_verdict && client_.offer_verdict->last_decided >= seq;
    });
  }
  [[nodiscard]] size_t keyframes() const { return service_->maps().at(0)->keyframe_count(); }

  testing::Scene scene_{11};
  ServiceOptions options_;
  std::unique_ptr<Service> service_;
  RawClient client_;
};

TEST_F(ProtocolTest, WhatIsSentAgainIsAppliedOnce) {
  const wire::MapSeed seed = make_seed(1);
  ASSERT_TRUE(seed_until_decided(seed));
  ASSERT_TRUE(client_.seed_verdict->accepted) << client_.seed_verdict->reason;
  for (int i = 0; i < 3; ++i) (void)client_.seeds.write(seed);
  const wire::KeyframeOffer offer = make_offer(1, 4);
  for (int i = 0; i < 3; ++i) (void)client_.offers.write(offer);
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.at(0).reason;
  (void)client_.offers.write(offer);
  // A later offer of the same writer comes after the repetitions: when it is decided, they have been seen.
  (void)client_.offers.write(make_offer(2, 7));
  ASSERT_TRUE(wait_decided(2));
  EXPECT_EQ(client_.offer_verdict->last_decided, 2U);
  EXPECT_EQ(client_.offer_verdict->recent.size(), 2U);
  EXPECT_EQ(keyframes(), 4U);
  EXPECT_EQ(service_->maps().size(), 1U);
  EXPECT_EQ(service_->maps()[0]->name, "desk");
}

TEST_F(ProtocolTest, AnOfferBeforeItsTurnWaitsForTheOneBefore) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  const wire::KeyframeOffer first = make_offer(1, 4);
  const wire::KeyframeOffer second = make_offer(2, 7);
  (void)client_.offers.write(second);
  (void)client_.offers.write(first);
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->last_decided, 1U);
  (void)client_.offers.write(second);
  ASSERT_TRUE(wait_decided(2));
  EXPECT_EQ(keyframes(), 4U);
}

TEST_F(ProtocolTest, UnusableOffersAreRefusedWithTheirReason) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  wire::KeyframeOffer unknown_map = make_offer(1, 4);
  unknown_map.map = MapId{{9, 9}};
  wire::KeyframeOffer old_epoch = make_offer(2, 4);
  old_epoch.epoch.value -= 1;
  wire::KeyframeOffer not_jpeg = make_offer(3, 4);
  not_jpeg.image.bytes.assign(1000, 0x55);
  wire::KeyframeOffer other_size = make_offer(4, 4);
  other_size.image = encode_image(GrayImage(32, 32), wire::ImageEncoding::kRaw);
  for (const auto* offer : {&unknown_map, &old_epoch, &not_jpeg, &other_size}) {
    (void)client_.offers.write(*offer);
    ASSERT_TRUE(wait_decided(offer->command.seq));
  }
  const auto& recent = client_.offer_verdict->recent;
  ASSERT_EQ(recent.size(), 4U);
  EXPECT_EQ(recent[0].decision, wire::OfferDecision::kUnknownMap);
  EXPECT_EQ(recent[1].decision, wire::OfferDecision::kStale);
  EXPECT_EQ(recent[2].decision, wire::OfferDecision::kDamaged);
  EXPECT_EQ(recent[3].decision, wire::OfferDecision::kDamaged);
  for (const wire::OfferOutcome& outcome : recent) EXPECT_FALSE(outcome.reason.empty());
  EXPECT_EQ(keyframes(), 2U);
}

TEST_F(ProtocolTest, AMessageThatClaimsToBeAnothersIsRefused) {
  wire::MapSeed forged = make_seed(1);
  forged.client = client_id_from_name("bob");
  (void)client_.seeds.write(forged);
  ASSERT_TRUE(seed_until_decided(make_seed(1))) << "its own is judged";
  EXPECT_EQ(service_->maps().size(), 1U);
}

TEST_F(ProtocolTest, ACommandWithAnUnknownCameraIsRefusedWithItsReason) {
  wire::MapSeed seed = make_seed(1);
  seed.camera = 7;
  ASSERT_TRUE(seed_until_decided(seed));
  EXPECT_FALSE(client_.seed_verdict->accepted);
  EXPECT_THAT(client_.seed_verdict->reason, HasSubstr("camera 7"));
  ASSERT_TRUE(seed_until_decided(make_seed(2)));
  ASSERT_TRUE(client_.seed_verdict->accepted) << client_.seed_verdict->reason;
  wire::KeyframeOffer offer = make_offer(1, 4);
  offer.camera_version = 9;
  ASSERT_TRUE(eventually([&] {
    (void)client_.offers.write(offer);
    client_.spin();
    return client_.offer_verdict && client_.offer_verdict->last_decided == 1;
  }));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kDamaged);
  EXPECT_THAT(client_.offer_verdict->recent.at(0).reason, HasSubstr("version 9"));
}

TEST_F(ProtocolTest, NobodyTakesANameFromItsHolderByDisposingOfIt) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  RawClient thief(options_.domain, "anna", scene_.camera());
  thief.session = SessionId{2002};
  RawClient eve(options_.domain, "eve", scene_.camera());
  int refusals = 0;
  ASSERT_TRUE(eventually([&] {
    eve.dispose_state_of(client_.id);
    thief.offer_verdict.reset();
    thief.spin();
    client_.spin();
    const auto& verdict = thief.offer_verdict;
    if (verdict && verdict->session == thief.session) {
      const bool refused = !verdict->recent.empty() && verdict->recent.at(0).seq == 0;
      EXPECT_TRUE(refused) << "the thief is served";
      if (refused) ++refusals;
      return !refused || refusals == 3;
    }
    return false;
  }));
  EXPECT_EQ(refusals, 3);
}

CameraPtr smaller_camera() {
  return value_of(make_camera({CameraModel::kPinholeRadtan, 200, 150, {165, 165, 99.5, 74.5}}));
}

TEST_F(ProtocolTest, AProcessThatIsRefusedTheNameDoesNotChangeItsHoldersCamera) {
  ASSERT_TRUE(seed_until_decided(make_seed(1))) << "so it holds the name";
  RawClient impostor(options_.domain, "anna", smaller_camera());
  impostor.session = SessionId{2002};
  ASSERT_TRUE(eventually([&] {
    client_.spin();
    impostor.spin();
    return impostor.offer_verdict && impostor.offer_verdict->session == impostor.session;
  })) << "it is told that it is not wanted";
  (void)client_.offers.write(make_offer(1, 4));
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.at(0).reason;
}

TEST_F(ProtocolTest, AVersionOfACameraNeverChanges) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  client_.announce(smaller_camera()->parameters());
  (void)client_.offers.write(make_offer(1, 4));
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.at(0).reason;
}

class FullServerTest : public ProtocolTest {
 protected:
  static ServiceOptions limited() {
    ServiceOptions options;
    options.max_maps = 1;
    options.max_memory_bytes = 1000;  // less than the first map
    return options;
  }
  FullServerTest() : ProtocolTest(limited()) {}
};

TEST_F(FullServerTest, RefusesMapsAndKeyframesWithItsReason) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  ASSERT_TRUE(client_.seed_verdict->accepted) << client_.seed_verdict->reason;
  (void)client_.offers.write(make_offer(1, 4));
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kFull);
  EXPECT_THAT(client_.offer_verdict->recent.at(0).reason, HasSubstr("--max-memory"));
  ASSERT_TRUE(seed_until_decided(make_seed(2)));
  EXPECT_FALSE(client_.seed_verdict->accepted);
  EXPECT_THAT(client_.seed_verdict->reason, HasSubstr("1 maps (--max-maps)"));
}

class LimitsTest : public ProtocolTest {
 protected:
  static ServiceOptions limited() {
    ServiceOptions options;
    options.rates.keyframes = 1;
    options.rates.queries = 1;
    options.max_labels = 1;
    options.max_keyframes = 3;
    return options;
  }
  LimitsTest() : ProtocolTest(limited()) {}
  /// One that no map would take: it has no camera.
  [[nodiscard]] wire::RequestOutcome decided(const wire::ClientRequest& request) {
    EXPECT_TRUE(eventually([&] {
      client_.spin();
      (void)client_.requests.write(request);
      return client_.reply && client_.reply->last_decided >= request.command.seq;
    }));
    return client_.reply ? client_.reply->recent.back() : wire::RequestOutcome{};
  }
};

TEST_F(LimitsTest, AMapTakesSoManyKeyframesAndLabelsAndSaysWhichOptionSaysSo) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  (void)client_.offers.write(make_offer(1, 4));
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.at(0).reason;
  (void)client_.offers.write(make_offer(2, 7));
  ASSERT_TRUE(wait_decided(2));
  EXPECT_EQ(client_.offer_verdict->recent.at(1).decision, wire::OfferDecision::kFull);
  EXPECT_EQ(client_.offer_verdict->recent.at(1).reason,
            "the map has 3 keyframes, which is all it may have (--max-keyframes)");
  const MapSnapshotPtr map = service_->maps().at(0);
  const SE3& seen = map->find(KeyframeId{2})->camera_from_map;
  for (const uint64_t seq : {1, 2}) {
    wire::ClientRequest label =
        *request_new_label(*map, seen, seen.inverse() * Eigen::Vector3d(0.1, 0.05, 1), "vice");
    label.client = client_.id;
    label.command = {client_.session, seq};
    const wire::RequestOutcome outcome = decided(label);
    EXPECT_EQ(outcome.decision, seq == 1 ? wire::RequestDecision::kDone : wire::RequestDecision::kFull);
    if (seq == 2) {
      EXPECT_EQ(outcome.reason, "the map has 1 labels, which is all it may have (--max-labels)");
    }
  }
}

/// Offers, queries and states as fast as they can be written: the flood is told why it is not served, what
/// waits is bounded, and another is served meanwhile as if nothing were.
TEST_F(LimitsTest, WhoFloodsTheServerIsToldWhyAndAnotherIsServed) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  RawClient eve(options_.domain, "eve", scene_.camera());
  wire::KeyframeOffer offer = testing::offer_of(eve, 1, scene_, *service_->maps().at(0), 4);
  offer.epoch.value -= 1;  // each is refused by the map, once it looks
  uint64_t seq = 0;
  ASSERT_TRUE(eventually([&] {
    eve.spin();
    return eve.map_info.has_value();
  }));
  ASSERT_TRUE(eventually([&] {
    for (int i = 0; i < 20; ++i) {
      offer.command.seq = std::max(seq, eve.offer_verdict ? eve.offer_verdict->last_decided : 0) + 1;
      seq = offer.command.seq;
      (void)eve.offers.write(offer);
      eve.say_state();
    }
    if (eve.offer_verdict && seq > eve.offer_verdict->last_decided + 20)
      seq = eve.offer_verdict->last_decided;
    eve.spin();
    if (!eve.offer_verdict || eve.offer_verdict->recent.empty()) return false;
    return eve.offer_verdict->recent.back().reason.find("too many keyframes") == 0;
  }));
  EXPECT_EQ(eve.offer_verdict->recent.back().decision, wire::OfferDecision::kBusy);
  EXPECT_THAT(eve.offer_verdict->recent.back().reason,
              HasSubstr("the server takes 1 a second of one client (--keyframe-rate)"));
  (void)client_.offers.write(make_offer(1, 4));
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.at(0).reason;
}

class NoLockstepTest : public ProtocolTest {
 protected:
  static ServiceOptions refusing() {
    ServiceOptions options;
    options.lockstep = false;
    return options;
  }
  NoLockstepTest() : ProtocolTest(refusing()) {}
  /// Writes it until the server has said that it does not serve this process.
  template <typename Write>
  [[nodiscard]] bool is_refused(const Write& write) {
    client_.session = SessionId{client_.session.value + 1};  // another process, which has been told nothing
    client_.offer_verdict.reset();
    return eventually([&] {
      client_.spin();
      write();
      if (!client_.offer_verdict || client_.offer_verdict->session != client_.session) return false;
      const auto& recent = client_.offer_verdict->recent;
      return recent.size() == 1 && recent[0].seq == 0 &&
             recent[0].reason.find("--lockstep allow") != std::string::npos;
    });
  }
};

TEST_F(NoLockstepTest, WhoAsksForItIsToldAndNotServedAndTheOthersAre) {
  EXPECT_TRUE(is_refused([&] { (void)client_.seeds.write(make_seed(1)); }));
  EXPECT_TRUE(service_->maps().empty());
  client_.session = SessionId{2001};
  wire::MapSeed seed = make_seed(1);
  seed.lockstep = false;
  ASSERT_TRUE(seed_until_decided(seed));
  ASSERT_TRUE(client_.seed_verdict->accepted) << client_.seed_verdict->reason;
  const size_t before = keyframes();
  EXPECT_TRUE(is_refused([&] { (void)client_.offers.write(make_offer(1, 4)); }));
  EXPECT_EQ(keyframes(), before);
  client_.session = SessionId{3001};
  wire::KeyframeOffer offer = make_offer(1, 4);
  offer.lockstep = false;
  ASSERT_TRUE(eventually([&] {
    client_.spin();
    (void)client_.offers.write(offer);
    return client_.offer_verdict && client_.offer_verdict->session == client_.session &&
           client_.offer_verdict->last_decided == 1;
  }));
  EXPECT_EQ(client_.offer_verdict->recent.back().decision, wire::OfferDecision::kAccepted)
      << client_.offer_verdict->recent.back().reason;
}

TEST_F(ProtocolTest, AMapThatIsFedFromOutsideTakesNoKeyframes) {
  ASSERT_TRUE(seed_until_decided(make_seed(1)));
  auto foreign = std::make_shared<MapSnapshot>(*service_->maps().at(0));
  foreign->map = MapId{{3}};
  service_->publish(foreign);
  ASSERT_TRUE(eventually([&] { return service_->maps().size() == 2; }));
  wire::KeyframeOffer offer = make_offer(1, 4);
  offer.map = foreign->map;
  (void)client_.offers.write(offer);
  ASSERT_TRUE(wait_decided(1));
  EXPECT_EQ(client_.offer_verdict->recent.at(0).decision, wire::OfferDecision::kNoRight);
}

}  // namespace
}  // namespace cairn
