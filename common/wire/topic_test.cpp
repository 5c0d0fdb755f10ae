// SPDX-License-Identifier: Apache-2.0
// What is written to a topic: what arrives, in which order and at whom.
#include <dds/dds.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <optional>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "common/wire/discovered.h"
#include "common/wire/internal/configuration.h"
#include "common/wire/internal/convert.h"
#include "common/wire/internal/endpoint.h"
#include "common/wire/internal/entity.h"
#include "common/wire/internal/qos.h"
#include "common/wire/partition.h"
#include "common/wire/repeated_bytes.h"
#include "common/wire/waiter.h"
#include "common/wire/wire_fixture.h"

namespace cairn::wire {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

TEST_F(WireTest, ALateJoinerGetsTheNewestValueOfEveryKey) {
  const Participant server = this->server();
  auto poses = writer<KeyframePoses>(server, "client.a.map.x");
  std::vector<KeyframePoses> newest;
  for (uint32_t block = 0; block < 10; ++block) {
    for (int version = 0; version < 3; ++version) {
      auto message = random_.make<KeyframePoses>();
      message.map = MapId{{7}};
      message.block.index = block;
      ASSERT_TRUE(poses.write(message));
      if (version == 2) newest.push_back(message);
    }
  }
  const Participant client = this->client();
  auto received = reader<KeyframePoses>(client, "client.a.map.x");
  const auto samples = collect(&received, newest.size());
  ASSERT_EQ(samples.size(), newest.size());
  std::set<uint32_t> blocks;
  for (const auto& sample : samples) {
    ASSERT_LT(sample.message->block.index, newest.size());
    blocks.insert(sample.message->block.index);
    EXPECT_TRUE(testing::same(*sample.message, newest[sample.message->block.index]));
  }
  EXPECT_EQ(blocks.size(), newest.size());
}

TEST_F(WireTest, RemovalAndDepartureAreToldApart) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto received = reader<MapInfo>(client, "client.a");
  std::optional<Writer<MapInfo>> infos = writer<MapInfo>(server, "client.a");
  const auto removed = random_.make<MapInfo>();
  const auto left = random_.make<MapInfo>();
  ASSERT_TRUE(infos->write(removed));
  ASSERT_TRUE(infos->write(left));
  ASSERT_EQ(collect(&received, 2).size(), 2U);
  ASSERT_TRUE(infos->dispose(removed));
  auto samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_FALSE(samples[0].message.has_value());
  EXPECT_EQ(samples[0].gone, Gone::kDisposed);
  EXPECT_EQ(samples[0].key.map, removed.map);
  infos.reset();
  samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(samples[0].gone, Gone::kNoWriters);
  EXPECT_EQ(samples[0].key.map, left.map);
}

TEST_F(WireTest, AValueRemovedBeforeItWasTakenComesWithItsRemoval) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto slow = reader<MapInfo>(client, "client.a");
  auto prompt = reader<MapInfo>(client, "client.a");
  auto infos = writer<MapInfo>(server, "client.a");
  ASSERT_TRUE(eventually([&] { return infos.matched() == 2; }));
  const auto removed = random_.make<MapInfo>();
  const auto last = random_.make<MapInfo>();
  ASSERT_TRUE(infos.write(removed));
  ASSERT_EQ(collect(&prompt, 1).size(), 1U);
  ASSERT_TRUE(infos.dispose(removed));
  ASSERT_TRUE(infos.write(last));
  ASSERT_EQ(collect(&prompt, 2).size(), 2U);
  std::vector<Sample<MapInfo>> samples;
  for (auto& sample : collect(&slow, 3)) {
    if ((sample.message ? *sample.message : sample.key).map == removed.map)
      samples.push_back(std::move(sample));
  }
  ASSERT_EQ(samples.size(), 2U);
  ASSERT_TRUE(samples[0].message.has_value());
  EXPECT_TRUE(testing::same(*samples[0].message, removed));
  EXPECT_FALSE(samples[1].message.has_value());
  EXPECT_EQ(samples[1].gone, Gone::kDisposed);
}

TEST_F(WireTest, AnEmergencyStopIsNotReplacedByWhatAnotherSaysAndOldOrdersAreGone) {
  const Participant server = this->server();  // in the place of a rig, which has one in each domain
  const Participant client = this->client();
  auto received = reader<RigCommand>(server, rig_partition("shoulder"));
  auto stopper = writer<RigCommand>(client, rig_partition("shoulder"));
  auto tracker = writer<RigCommand>(client, rig_partition("shoulder"));
  ASSERT_TRUE(
      eventually([&] { return received.matched() == 2 && stopper.matched() + tracker.matched() == 2; }));
  auto order = random_.make<RigCommand>();
  order.rig = "shoulder";
  order.mode = RigMode::kStop;
  ASSERT_TRUE(stopper.write(order));
  order.mode = RigMode::kLock;
  ASSERT_TRUE(tracker.write(order));
  const auto samples = collect(&received, 2);
  ASSERT_EQ(samples.size(), 2U);
  // Two writers have no common order.
  EXPECT_EQ(std::set({samples[0].message->mode, samples[1].message->mode}),
            std::set({RigMode::kStop, RigMode::kLock}));
  ASSERT_TRUE(tracker.write(order));
  std::this_thread::sleep_for(300ms);  // three times their life
  EXPECT_TRUE(received.take().empty());
}

TEST_F(WireTest, CommandsKeepTheirOrder) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto received = reader<KeyframeOffer>(server, kEveryClient);
  auto offers = writer<KeyframeOffer>(client, client_partition("a"));
  ASSERT_TRUE(eventually([&] { return offers.matched() == 1 && received.matched() == 1; }));
  constexpr uint64_t kOffers = 16;
  auto offer = random_.make<KeyframeOffer>();
  offer.image = random_.image(640, 480);
  offer.candidates.clear();  // of the image that was there
  offer.still_mask.clear();
  for (uint64_t seq = 1; seq <= kOffers; ++seq) {
    offer.command.seq = seq;
    offer.reference_command = seq - 1;
    ASSERT_TRUE(offers.write(offer));
  }
  const auto samples = collect(&received, kOffers);
  ASSERT_EQ(samples.size(), kOffers);
  for (uint64_t i = 0; i < kOffers; ++i) EXPECT_EQ(samples[i].message->command.seq, i + 1);
}

TEST_F(WireTest, APublicationProvesItsPartition) {
  const Participant server = this->server();
  auto received = reader<KeyframeOffer>(server, kEveryClient);
  const Participant alice = this->client();
  const Participant bob = this->client();
  auto from_alice = writer<KeyframeOffer>(alice, client_partition("alice"));
  auto from_bob = writer<KeyframeOffer>(bob, client_partition("bob"));
  ASSERT_TRUE(eventually(
      [&] { return from_alice.matched() == 1 && from_bob.matched() == 1 && received.matched() == 2; }));
  auto offer = random_.make<KeyframeOffer>();
  offer.client = client_id_from_name("bob");  // alice lies
  ASSERT_TRUE(from_alice.write(offer));
  auto samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(received.partition_of(samples[0].publication), "client.alice");
  ASSERT_TRUE(from_bob.write(offer));
  samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(received.partition_of(samples[0].publication), "client.bob");
  EXPECT_EQ(received.partition_of(PublicationHandle{12345}), std::nullopt);
}

TEST_F(WireTest, TwoProcessesThatClaimOneCameraAreBothHeardAndToldApart) {
  const Participant server = this->server();
  auto received = reader<CameraMessage>(server, kEveryClient);
  const Participant first = this->client();
  const Participant second = this->client();
  auto from_first = writer<CameraMessage>(first, client_partition("anna"));
  auto from_second = writer<CameraMessage>(second, client_partition("anna"));
  auto offers = writer<KeyframeOffer>(first, client_partition("anna"));
  auto received_offers = reader<KeyframeOffer>(server, kEveryClient);
  ASSERT_TRUE(eventually(
      [&] { return from_first.matched() == 1 && from_second.matched() == 1 && offers.matched() == 1; }));
  auto camera = random_.make<CameraMessage>();
  camera.version = 1;
  ASSERT_TRUE(from_first.write(camera));
  camera.version = 2;  // the same instance
  ASSERT_TRUE(from_second.write(camera));
  ASSERT_TRUE(offers.write(random_.make<KeyframeOffer>()));
  const auto offer = collect(&received_offers, 1);
  const auto cameras = collect(&received, 2);
  ASSERT_EQ(cameras.size(), 2U);
  ASSERT_EQ(offer.size(), 1U);
  const auto of_first = static_cast<size_t>(cameras[0].message->version == 1 ? 0 : 1);
  const auto peer = received.peer_of(cameras[of_first].publication);
  ASSERT_TRUE(peer.has_value());
  EXPECT_EQ(received_offers.peer_of(offer[0].publication), peer);
  EXPECT_NE(received.peer_of(cameras[1 - of_first].publication), peer);
  EXPECT_EQ(received.peer_of(PublicationHandle{12345}), std::nullopt);
}

/// What one client says under the key of another, as often as it likes, does not push out what that one said.
template <typename Message>
void expect_nothing_is_displaced(const Participant& server, const Participant& anna, const Participant& eve,
                                 Message message, const std::string& kind = "client.") {
  auto received = reader<Message>(server, kind + "*");
  auto watched = reader<Message>(server, kind + "*");  // sees what has come, and leaves it to the other
  auto of_anna = writer<Message>(anna, kind + "anna");
  auto of_eve = writer<Message>(eve, kind + "eve");
  ASSERT_TRUE(eventually([&] {
    return received.matched() == 2 && watched.matched() == 2 && of_anna.matched() == 2 &&
           of_eve.matched() == 2;
  }));
  constexpr size_t kForged = 100;
  ASSERT_TRUE(of_anna.write(message));
  size_t come = 0;
  const auto write_and_see = [&](Writer<Message>& from, size_t count) {
    ASSERT_TRUE(eventually([&] {
      if (come < count) (void)from.write(message);
      come += watched.take().size();
      return come >= count;
    }));
  };
  ASSERT_TRUE(eventually([&] { return (come += watched.take().size()) == 1; }));
  write_and_see(of_eve, kForged);
  size_t of_annas = 0;
  for (size_t all = 0; all < kForged;) {
    const auto samples = collect(&received, 1);
    ASSERT_FALSE(samples.empty());
    all += samples.size();
    for (const auto& sample : samples) {
      if (received.partition_of(sample.publication) == kind + "anna") ++of_annas;
    }
  }
  EXPECT_EQ(of_annas, 1U) << topic_name<Message>();
}

TEST_F(WireTest, WhatAClientSaysUnderTheKeyOfAnotherPushesOutNothing) {
  const Participant server = this->server();
  const Participant anna = this->client();
  const Participant eve = this->client();
  expect_nothing_is_displaced(server, anna, eve, random_.make<TrackerStateMessage>());
  expect_nothing_is_displaced(server, anna, eve, random_.make<RelocQuery>());
  expect_nothing_is_displaced(server, anna, eve, random_.make<CameraMessage>());
  expect_nothing_is_displaced(server, anna, eve, random_.make<RigState>(), "rig.");
}

TEST_F(WireTest, WhatIsForOneClientDoesNotReachAnother) {
  const Participant server = this->server();
  const Participant alice = this->client();
  const Participant bob = this->client();
  auto at_alice = reader<MapInfo>(alice, client_partition("alice"));
  auto at_bob = reader<MapInfo>(bob, client_partition("bob"));
  auto to_alice = writer<MapInfo>(server, client_partition("alice"));
  auto to_bob = writer<MapInfo>(server, client_partition("bob"));
  ASSERT_TRUE(eventually([&] { return to_alice.matched() == 1 && to_bob.matched() == 1; }));
  const auto first = random_.make<MapInfo>();
  const auto second = random_.make<MapInfo>();
  ASSERT_TRUE(to_alice.write(first));
  ASSERT_TRUE(to_bob.write(second));
  const auto got_alice = collect(&at_alice, 1);
  const auto got_bob = collect(&at_bob, 1);
  ASSERT_EQ(got_alice.size(), 1U);
  ASSERT_EQ(got_bob.size(), 1U);
  EXPECT_EQ(got_alice[0].message->map, first.map);
  EXPECT_EQ(got_bob[0].message->map, second.map);
}

/// As often as it takes until something has been lost in both directions.
TEST_F(WireTest, EverythingArrivesThroughHeavyLoss) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  const Participant server = this->server(200);
  const Participant client = this->client(200);
  auto at_client = reader<PointPatches>(client, "client.a.map.x");
  auto at_server = reader<KeyframeOffer>(server, kEveryClient);
  auto patches = writer<PointPatches>(server, "client.a.map.x");
  auto offers = writer<KeyframeOffer>(client, client_partition("a"));
  ASSERT_TRUE(eventually(
      [&] { return patches.matched() == 1 && offers.matched() == 1 && at_server.matched() == 1; }));
  constexpr uint32_t kBlocks = 20;
  constexpr uint64_t kOffers = 8;
  auto offer = random_.make<KeyframeOffer>();
  offer.image = random_.image(320, 240);
  offer.candidates.clear();  // of the image that was there
  offer.still_mask.clear();
  const auto has_lost = [](const Participant& sender) { return repeated_bytes(sender) > 0; };
  for (int round = 0; round < kMostRounds && !(has_lost(server) && has_lost(client)); ++round) {
    for (uint32_t index = 0; index < kBlocks; ++index) {
      auto block = random_.make<PointPatches>();
      block.map = MapId{{static_cast<uint8_t>(1 + round)}};
      block.block.index = index;
      ASSERT_TRUE(patches.write(block));
    }
    const uint64_t first = 1 + kOffers * static_cast<uint64_t>(round);
    for (uint64_t seq = first; seq < first + kOffers; ++seq) {
      offer.command.seq = seq;
      offer.reference_command = seq - 1;
      ASSERT_TRUE(offers.write(offer));
    }
    EXPECT_EQ(collect(&at_client, kBlocks).size(), kBlocks);
    const auto received = collect(&at_server, kOffers);
    ASSERT_EQ(received.size(), kOffers);
    for (uint64_t i = 0; i < kOffers; ++i) EXPECT_EQ(received[i].message->command.seq, first + i);
  }
  EXPECT_TRUE(has_lost(server)) << "nothing that it sent";
  EXPECT_TRUE(has_lost(client)) << "nothing that it sent";
}

TEST_F(WireTest, UnfitSamplesAreDroppedCountedAndLoggedOnce) {
  std::ostringstream text;
  const Participant server = this->server(
      0, "loopback",
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text)));
  const Participant client = this->client();
  auto received = reader<TrackerStateMessage>(server, kEveryClient);
  auto state = writer<TrackerStateMessage>(client, client_partition("a"));
  ASSERT_TRUE(eventually([&] { return state.matched() == 1 && received.matched() == 1; }));
  auto message = random_.make<TrackerStateMessage>();
  message.quality = std::numeric_limits<float>::quiet_NaN();
  for (uint64_t count = 1; count <= 2; ++count) {
    ASSERT_TRUE(state.write(message));
    ASSERT_TRUE(eventually([&] {
      EXPECT_TRUE(received.take().empty());
      return received.invalid() == count;
    }));
  }
  const std::string logged = text.str();
  EXPECT_THAT(logged, HasSubstr("a TrackerState from partition 'client.a' is dropped: quality"));
  EXPECT_EQ(std::count(logged.begin(), logged.end(), '\n'), 1) << logged;
  message.quality = 1;
  ASSERT_TRUE(state.write(message));
  EXPECT_EQ(collect(&received, 1).size(), 1U);
  EXPECT_EQ(received.invalid(), 2U);
}

TEST_F(WireTest, MessagesBeyondTheBoundsOfTheWireAreRefusedAtTheWriter) {
  const Participant server = this->server();
  auto verdicts = writer<OfferVerdict>(server, client_partition("a"));
  OfferVerdict verdict;
  verdict.recent.resize(17);
  const Status refused = verdicts.write(verdict);
  ASSERT_FALSE(refused.has_value());
  EXPECT_THAT(refused.error().message, HasSubstr("OfferVerdict"));
  verdict.recent.resize(16);
  EXPECT_TRUE(verdicts.write(verdict).has_value());
}

TEST_F(WireTest, AMessageThatNoPeerTakesIsRefusedAtTheWriterByName) {
  const Participant server = this->server();
  auto requests = writer<AdminRequest>(server, "operator.a");
  auto request = random_.make<AdminRequest>();
  request.data.assign(internal::kMaxSampleBytes, 1);
  const Status refused = requests.write(request);
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().code, ErrorCode::kRefused);
  EXPECT_THAT(refused.error().message, HasSubstr("AdminRequest of 37 MB"));
  EXPECT_THAT(refused.error().message, HasSubstr("36 MB at most"));
}

/// A peer of another making, whose middleware sends what it is given.
TEST_F(WireTest, WhatIsLargerThanAnyMessageIsNotPutTogetherAndHoldsUpNothing) {
  const Participant server = this->server();
  auto received = reader<AdminRequest>(server, kEveryOperator);
  ParticipantOptions options;
  options.domain = domain_;
  std::string xml = internal::make_configuration(options, {"127.0.0.1", "lo", "127.0.0.1"}).value();
  const std::string bound =
      "<MaxSampleSize>" + std::to_string(internal::kMaxSampleBytes) + "B</MaxSampleSize>";
  ASSERT_THAT(xml, HasSubstr(bound));
  xml.erase(xml.find(bound), bound.size());
  constexpr dds_domainid_t kUnusedHere = 4242;
  const internal::Entity domain(dds_create_domain(kUnusedHere, xml.c_str()));
  ASSERT_GT(domain.handle(), 0);
  const dds_entity_t peer = dds_create_participant(kUnusedHere, nullptr, nullptr);
  const dds_entity_t topic =
      dds_create_topic(peer, &cairn_AdminRequest_desc, "AdminRequest", nullptr, nullptr);
  const dds_entity_t publisher =
      dds_create_publisher(peer, internal::partition_qos("operator.a").get(), nullptr);
  const dds_entity_t requests =
      dds_create_writer(publisher, topic, internal::writer_qos(internal::QosClass::kCommand).get(), nullptr);
  ASSERT_GT(requests, 0);
  ASSERT_TRUE(eventually([&] { return received.matched() == 1; }));
  const auto small = random_.make<AdminRequest>();
  auto large = small;
  large.data.assign(internal::kMaxSampleBytes + 1, 1);
  internal::Scratch scratch;
  const auto large_sample = internal::encode(large, &scratch);
  const auto small_sample = internal::encode(small, &scratch);
  ASSERT_EQ(dds_write(requests, &large_sample), DDS_RETCODE_OK);
  ASSERT_EQ(dds_write(requests, &small_sample), DDS_RETCODE_OK);
  const auto samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_TRUE(testing::same(*samples[0].message, small));
  EXPECT_EQ(received.invalid(), 0U) << "it was put together first";
  auto unfit = small;
  unfit.data.assign(kMaxAdminData + 1, 1);
  const auto unfit_sample = internal::encode(unfit, &scratch);
  ASSERT_EQ(dds_write(requests, &unfit_sample), DDS_RETCODE_OK);
  EXPECT_TRUE(eventually([&] {
    (void)received.take();
    return received.invalid() == 1;
  })) << "what is put together, and no message, is counted";
}

TEST_F(WireTest, WaiterWakesForDataForCallsAndForTime) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto waiter = Waiter::create(client).value();
  EXPECT_FALSE(waiter.wait(1ms));
  waiter.wake();
  EXPECT_TRUE(waiter.wait(10s)) << "a call before the wait counts";
  EXPECT_FALSE(waiter.wait(1ms)) << "but only once";
  std::thread caller([&] { waiter.wake(); });
  EXPECT_TRUE(waiter.wait(10s));
  caller.join();

  std::optional<Reader<MapInfo>> infos = reader<MapInfo>(client, "client.a");
  ASSERT_TRUE(waiter.attach({*infos}));
  auto info = writer<MapInfo>(server, "client.a");
  ASSERT_TRUE(info.write(random_.make<MapInfo>()));
  EXPECT_TRUE(waiter.wait(10s));
  EXPECT_TRUE(waiter.wait(10s)) << "not taken yet";
  EXPECT_EQ(infos->take().size(), 1U);
  EXPECT_FALSE(waiter.wait(1ms));
  infos.reset();
  EXPECT_FALSE(waiter.wait(1ms)) << "a reader that has gone is no trouble";
}

/// While a loan is out, the middleware takes new memory for the next, and nobody gives that back.
TEST_F(WireTest, SamplesGoBackToTheMiddlewareWhenTheirVisitorThrows) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto received = reader<MapInfo>(client, "client.a");
  auto info = writer<MapInfo>(server, "client.a");
  ASSERT_TRUE(eventually([&] { return info.matched() == 1; }));
  auto& entity = const_cast<internal::ReaderEntity&>(received.entity());
  std::set<const void*> memory;
  const auto visit = [&memory](const void* sample, const dds_sample_info_t&) {
    memory.insert(sample);
    throw std::runtime_error("no memory");
  };
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(info.write(random_.make<MapInfo>()));
    ASSERT_TRUE(eventually([&] {
      try {
        entity.take(visit);
      } catch (const std::runtime_error&) {
        return true;
      }
      return false;
    }));
  }
  EXPECT_EQ(memory.size(), 1U);
}

TEST_F(WireTest, TrafficCountsMessagesOnBothSides) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto received = reader<PointPatches>(client, "client.a");
  auto patches = writer<PointPatches>(server, "client.a");
  ASSERT_TRUE(eventually([&] { return patches.matched() == 1; }));
  PointPatches message = random_.make<PointPatches>();
  message.block.points.assign(1, random_.source({1}));
  ASSERT_TRUE(patches.write(message));
  ASSERT_EQ(collect(&received, 1).size(), 1U);
  EXPECT_GT(server.traffic().bytes_sent, 576U);
  EXPECT_LT(server.traffic().bytes_sent, 1000U);
  EXPECT_EQ(server.traffic().bytes_sent, client.traffic().bytes_received);
  EXPECT_EQ(client.traffic().bytes_sent, 0U);
}

}  // namespace
}  // namespace cairn::wire
