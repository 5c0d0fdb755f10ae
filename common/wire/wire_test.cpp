// SPDX-License-Identifier: Apache-2.0
// The middleware itself, over the loopback interface. Each test has a domain of its own.
#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <future>
#include <limits>
#include <set>
#include <sstream>
#include <thread>

#include "common/wire/discovered_readers.h"
#include "common/wire/internal/context.h"
#include "common/wire/log_redirect.h"
#include "common/wire/partition.h"
#include "common/wire/test_messages.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn::wire {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using Clock = std::chrono::steady_clock;

constexpr unsigned kSeed = 11;
constexpr uint32_t kDomains = 95;  ///< domains 5 to 99: their ports lie below those that the kernel hands out

bool eventually(const std::function<bool()>& predicate, std::chrono::milliseconds limit = 20s) {
  const auto deadline = Clock::now() + limit;
  while (!predicate()) {
    if (Clock::now() > deadline) return false;
    std::this_thread::sleep_for(2ms);
  }
  return true;
}

class WireTest : public ::testing::Test {
 protected:
  /// A server in a domain that nobody else uses at this moment.
  Participant server(int loss_per_mille = 0, const std::string& profile = "loopback",
                     Logger log = null_logger()) {
    ParticipantOptions options;
    options.log = std::move(log);
    options.role = Role::kServer;
    options.profile = profile;
    options.loss_per_mille = loss_per_mille;
    for (uint32_t i = 0; i < kDomains; ++i) {
      options.domain = 5 + (static_cast<uint32_t>(getpid()) * 7 + i) % kDomains;
      auto made = Participant::create(options);
      if (made) {
        domain_ = options.domain;
        return *std::move(made);
      }
      if (made.error().code != ErrorCode::kRefused) throw std::runtime_error(made.error().message);
    }
    throw std::runtime_error("no free domain");
  }
  Participant server_again() {
    ParticipantOptions options;
    options.role = Role::kServer;
    options.domain = domain_;
    return Participant::create(options).value();
  }
  /// A client of that server.
  Participant client(int loss_per_mille = 0) const {
    ParticipantOptions options;
    options.domain = domain_;
    options.loss_per_mille = loss_per_mille;
    return Participant::create(options).value();
  }

  const LogRedirect quiet_{null_logger()};  // the search for a free domain is noisy
  testing::RandomMessages random_{kSeed};
  uint32_t domain_ = 0;
};

template <typename Message>
Writer<Message> writer(const Participant& participant, std::string_view partition) {
  return Writer<Message>::create(participant, partition).value();
}
template <typename Message>
Reader<Message> reader(const Participant& participant, std::string_view partition) {
  return Reader<Message>::create(participant, partition).value();
}

/// Takes until `count` samples have come.
template <typename Message>
std::vector<Sample<Message>> collect(Reader<Message>* from, size_t count) {
  std::vector<Sample<Message>> all;
  eventually([&] {
    for (auto& sample : from->take()) all.push_back(std::move(sample));
    return all.size() >= count;
  });
  return all;
}

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
  auto witness = reader<MapInfo>(client, "client.a");
  auto infos = writer<MapInfo>(server, "client.a");
  ASSERT_TRUE(eventually([&] { return infos.matched() == 2; }));
  const auto removed = random_.make<MapInfo>();
  const auto last = random_.make<MapInfo>();
  ASSERT_TRUE(infos.write(removed));
  ASSERT_EQ(collect(&witness, 1).size(), 1U);
  ASSERT_TRUE(infos.dispose(removed));
  ASSERT_TRUE(infos.write(last));
  ASSERT_EQ(collect(&witness, 2).size(), 2U);
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

TEST_F(WireTest, CommandsKeepTheirOrder) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto received = reader<KeyframeOffer>(server, kEveryClient);
  auto offers = writer<KeyframeOffer>(client, client_partition("a"));
  ASSERT_TRUE(eventually([&] { return offers.matched() == 1 && received.matched() == 1; }));
  constexpr uint64_t kOffers = 16;
  auto offer = random_.make<KeyframeOffer>();
  offer.image = random_.image(640, 480);
  for (uint64_t seq = 1; seq <= kOffers; ++seq) {
    offer.command.seq = seq;
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

TEST_F(WireTest, ReadersOfPeersAreDiscoveredAndTheirEndIsSeen) {
  const Participant server = this->server();
  auto discovered = DiscoveredReaders::create(server).value();
  auto own = reader<MapSeed>(server, kEveryClient);
  const MapId map{{9}};
  const Participant client = this->client();
  std::optional<Reader<MapCommit>> commits = reader<MapCommit>(client, map_partition("a", map));
  std::vector<DiscoveredReader> changes;
  const auto changed = [&](size_t count) {
    return eventually([&] {
      for (auto& change : discovered.take()) changes.push_back(std::move(change));
      return changes.size() >= count;
    });
  };
  ASSERT_TRUE(changed(1));
  EXPECT_EQ(changes[0].topic, topic_name<MapCommit>());
  EXPECT_EQ(changes[0].partitions, std::vector<std::string>{map_partition("a", map)});
  EXPECT_FALSE(changes[0].gone);
  commits.reset();
  ASSERT_TRUE(changed(2));
  EXPECT_TRUE(changes[1].gone);
  EXPECT_EQ(changes[1].handle, changes[0].handle);
  EXPECT_EQ(changes[1].topic, topic_name<MapCommit>());
  EXPECT_EQ(changes.size(), 2U) << "its own readers are not news";
}

TEST_F(WireTest, ClientsDoNotDiscoverEachOther) {
  const Participant server = this->server();
  auto states_at_server = reader<TrackerStateMessage>(server, kEveryClient);
  auto seeds_at_server = reader<MapSeed>(server, kEveryClient);
  const Participant alice = this->client();
  const Participant bob = this->client();
  auto seen_by_alice = DiscoveredReaders::create(alice).value();
  auto state = writer<TrackerStateMessage>(alice, client_partition("alice"));
  auto seeds = writer<MapSeed>(bob, client_partition("bob"));
  auto spying = reader<TrackerStateMessage>(bob, "*");
  ASSERT_TRUE(eventually([&] {
    return states_at_server.matched() == 1 && seeds_at_server.matched() == 1 && state.matched() == 1 &&
           seeds.matched() == 1;
  }));
  // Longer than a period of discovery, after the server has met both.
  const auto message = random_.make<TrackerStateMessage>();
  EXPECT_FALSE(eventually(
      [&] {
        EXPECT_TRUE(state.write(message));
        return state.matched() > 1 || spying.matched() > 0;
      },
      1500ms));
  EXPECT_TRUE(spying.take().empty());
  const auto seen = seen_by_alice.take();
  EXPECT_EQ(seen.size(), 2U) << "the server's two readers, and none of bob's";
}

TEST_F(WireTest, EitherMayStartFirst) {
  { const Participant reserve = this->server(); }  // finds a free domain
  const Participant client = this->client();
  auto status_reader = reader<ServerStatus>(client, client_partition("a"));
  const Participant server = server_again();
  auto status = writer<ServerStatus>(server, client_partition("a"));
  const auto message = random_.make<ServerStatus>();
  ASSERT_TRUE(status.write(message));
  const auto samples = collect(&status_reader, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_TRUE(testing::same(*samples[0].message, message));
}

TEST_F(WireTest, AServerOnANetworkServesItsOwnHostToo) {
  const Participant server = this->server(0, "wifi");
  const Participant client = this->client();
  auto received = reader<MapInfo>(client, client_partition("a"));
  auto infos = writer<MapInfo>(server, client_partition("a"));
  const auto message = random_.make<MapInfo>();
  ASSERT_TRUE(infos.write(message));
  const auto samples = collect(&received, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_TRUE(testing::same(*samples[0].message, message));
}

TEST_F(WireTest, ARestartedServerIsSeen) {
  std::optional<Participant> server = this->server();
  const Participant client = this->client();
  auto at_client = reader<ServerStatus>(client, client_partition("a"));
  const auto before = random_.make<ServerStatus>();
  {
    auto status = writer<ServerStatus>(*server, client_partition("a"));
    ASSERT_TRUE(status.write(before));
    ASSERT_EQ(collect(&at_client, 1).size(), 1U);
    EXPECT_EQ(at_client.alive_writers(), 1);
  }
  server.reset();
  ASSERT_TRUE(eventually([&] { return at_client.alive_writers() == 0 && at_client.matched() == 0; }));
  EXPECT_EQ(at_client.take().size(), 1U) << "its last word is gone";
  server = server_again();
  auto status = writer<ServerStatus>(*server, client_partition("a"));
  const auto after = random_.make<ServerStatus>();
  ASSERT_TRUE(status.write(after));
  const auto samples = collect(&at_client, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_EQ(samples[0].message->server, after.server);
  EXPECT_EQ(at_client.alive_writers(), 1);
}

TEST_F(WireTest, AHungServerIsSeen) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto at_client = reader<ServerStatus>(client, client_partition("a"));
  auto status = writer<ServerStatus>(server, client_partition("a"));
  const auto message = random_.make<ServerStatus>();
  ASSERT_TRUE(status.write(message));
  ASSERT_TRUE(eventually([&] { return at_client.alive_writers() == 1; }));
  ASSERT_TRUE(eventually([&] { return at_client.alive_writers() == 0; })) << "silence is not seen";
  EXPECT_EQ(at_client.matched(), 1) << "it has not gone, it hangs";
  ASSERT_TRUE(status.write(message));
  EXPECT_TRUE(eventually([&] { return at_client.alive_writers() == 1; }));
}

/// As one whose address has gone, or that is stopped: it keeps its readers until its lease is over, and
/// acknowledges nothing.
TEST_F(WireTest, ClosingWaitsForNobody) {
  constexpr size_t kWriters = 30;  // a second each would be more than is waited for here
  const Participant server = this->server();
  const Participant client = this->client();
  std::vector<Writer<ServerStatus>> writers;
  std::vector<Reader<ServerStatus>> readers;
  for (size_t i = 0; i < kWriters; ++i) {
    const std::string partition = client_partition(std::to_string(i));
    writers.push_back(writer<ServerStatus>(server, partition));
    readers.push_back(reader<ServerStatus>(client, partition));
  }
  ASSERT_TRUE(eventually([&] {
    return std::all_of(writers.begin(), writers.end(), [](const auto& each) { return each.matched() == 1; });
  }));
  ASSERT_EQ(dds_domain_set_deafmute(client.context()->participant(), true, true, DDS_INFINITY),
            DDS_RETCODE_OK);
  for (auto& each : writers) ASSERT_TRUE(each.write(random_.make<ServerStatus>()));
  auto closed = std::async(std::launch::async, [&] { writers.clear(); });
  EXPECT_EQ(closed.wait_for(20s), std::future_status::ready);
}

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
  for (uint32_t index = 0; index < kBlocks; ++index) {
    auto block = random_.make<PointPatches>();
    block.map = MapId{{1}};
    block.block.index = index;
    ASSERT_TRUE(patches.write(block));
  }
  auto offer = random_.make<KeyframeOffer>();
  offer.image = random_.image(320, 240);
  for (uint64_t seq = 1; seq <= kOffers; ++seq) {
    offer.command.seq = seq;
    ASSERT_TRUE(offers.write(offer));
  }
  EXPECT_EQ(collect(&at_client, kBlocks).size(), kBlocks);
  const auto received = collect(&at_server, kOffers);
  ASSERT_EQ(received.size(), kOffers);
  for (uint64_t i = 0; i < kOffers; ++i) EXPECT_EQ(received[i].message->command.seq, i + 1);
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

TEST_F(WireTest, ASecondServerOfADomainIsRefused) {
  const Participant server = this->server();
  ParticipantOptions options;
  options.role = Role::kServer;
  options.domain = domain_;
  const auto second = Participant::create(options);
  ASSERT_FALSE(second.has_value());
  EXPECT_EQ(second.error().code, ErrorCode::kRefused);
  // This one here is another program than a server.
  EXPECT_THAT(second.error().message, HasSubstr("UDP port " + std::to_string(server_port(domain_))));
  EXPECT_THAT(second.error().message, HasSubstr("(process " + std::to_string(getpid()) + ")"));
  EXPECT_THAT(second.error().message, HasSubstr("another --domain"));
}

TEST_F(WireTest, AProfileThatTheMiddlewareRefusesIsNamed) {
  const std::string path = ::testing::TempDir() + "cairn-bad-profile-" + std::to_string(getpid()) + ".xml";
  std::ofstream(path) << "<CycloneDDS><Domain Id=\"any\"><NoSuchThing>1</NoSuchThing></Domain></CycloneDDS>";
  ParticipantOptions options;
  options.profile = path;
  options.domain = 101;
  const auto refused = Participant::create(options);
  ::unlink(path.c_str());
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(refused.error().message, HasSubstr(path));
}

TEST_F(WireTest, DomainsRunSideBySide) {
  struct Site {
    Participant server;
    Participant client;
    Writer<MapInfo> infos;
    Reader<MapInfo> received;
    MapInfo message;
  };
  std::vector<Site> sites;
  for (int i = 0; i < 4; ++i) {
    Participant server = this->server();
    Participant client = this->client();
    auto infos = writer<MapInfo>(server, "client.a");
    auto received = reader<MapInfo>(client, "client.a");
    sites.push_back({std::move(server), std::move(client), std::move(infos), std::move(received),
                     random_.make<MapInfo>()});
  }
  for (Site& site : sites) ASSERT_TRUE(site.infos.write(site.message));
  for (Site& site : sites) {
    const auto samples = collect(&site.received, 1);
    ASSERT_EQ(samples.size(), 1U);
    EXPECT_TRUE(testing::same(*samples[0].message, site.message));
    EXPECT_EQ(site.received.matched(), 1);
  }
}

TEST(LogRedirect, PassesOnAFewLinesAndCountsTheRest) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  {
    const LogRedirect redirect(logger, 3);
    for (int i = 0; i < 100; ++i) dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "line %d\n", i);
  }
  const std::string said = text.str();
  EXPECT_THAT(said, HasSubstr("dds: line 0"));
  EXPECT_LE(std::count(said.begin(), said.end(), '\n'), 9)
      << "3 a second, unless the machine stood still for two";
  EXPECT_GE(std::count(said.begin(), said.end(), '\n'), 3);
}

TEST(LogRedirect, SaysTheSameThingOnce) {
  std::ostringstream text;
  auto logger =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text));
  {
    const LogRedirect redirect(logger, 1000);
    for (int i = 0; i < 50; ++i) dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "is away\n");
    dds_log(DDS_LC_WARNING, __FILE__, __LINE__, __func__, "something else\n");
  }
  const std::string said = text.str();
  EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 2)
      << said << "unless the machine stood still for 10 s";
  EXPECT_THAT(said, HasSubstr("something else (49 lines passed over)"));
}

}  // namespace
}  // namespace cairn::wire
