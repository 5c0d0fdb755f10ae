// SPDX-License-Identifier: Apache-2.0
// Servers and clients: who discovers whom, and how each sees the other come, hang and go.
#include <dds/dds.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <future>
#include <optional>

#include "common/wire/discovered.h"
#include "common/wire/internal/context.h"
#include "common/wire/partition.h"
#include "common/wire/wire_fixture.h"

namespace cairn::wire {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

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

TEST_F(WireTest, TheCamerasOfAWearerHearEachOtherAndNoOtherWearers) {
  const Participant server = this->server();  // of a domain of our own
  const auto camera_of = [&](const std::string& wearer) {
    ParticipantOptions options;
    options.role = Role::kWearerCamera;
    options.domain = domain_;
    options.tag = "wearer." + wearer;
    return Participant::create(options).value();
  };
  const Participant hand = camera_of("ada");
  const Participant shoulder = camera_of("ada");
  const Participant other = camera_of("bob");
  auto message = random_.make<CameraPicture>();
  message.image.bytes.resize(kMaxCameraImageBytes / 16, 7);
  auto sent = writer<CameraPicture>(shoulder, wearer_partition("ada"));
  auto seen = reader<CameraPicture>(hand, wearer_partition("ada"));
  auto overheard = reader<CameraPicture>(other, "*");
  auto at_server = reader<CameraPicture>(server, "*");
  ASSERT_TRUE(eventually([&] { return sent.matched() == 1 && seen.matched() == 1; }));
  ASSERT_TRUE(sent.write(message));
  const auto samples = collect(&seen, 1);
  ASSERT_EQ(samples.size(), 1U);
  EXPECT_TRUE(testing::same(*samples[0].message, message));
  EXPECT_FALSE(eventually([&] { return sent.matched() > 1 || overheard.matched() + at_server.matched() > 0; },
                          1200ms));
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

}  // namespace
}  // namespace cairn::wire
