// SPDX-License-Identifier: Apache-2.0
// The server as a process that starts late, is killed and comes back.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>

#include "tests/integration/server_process.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using testing::ServerProcess;

SessionOptions options_for(int domain) {
  SessionOptions options;
  options.domain = domain;
  options.name = "anna";
  options.lockstep = true;
  return options;
}

TEST(ServerRestart, AKilledServerIsSeenToBeGoneAndItsSuccessorToLackTheMap) {
  const testing::Scene scene(11);
  auto server = std::make_unique<ServerProcess>();
  const int domain = server->domain();
  const auto session = testing::open_session(options_for(domain), scene.camera());
  ASSERT_TRUE(session->wait_for_server(60s));
  session->send_seed(testing::make_seed(scene));
  ASSERT_TRUE(session->wait_until_settled(60s));
  const MapSnapshotPtr replica = session->snapshot();
  ASSERT_NE(replica, nullptr);
  const auto make_offer = [&] {
    testing::Frame frame = testing::make_offer(scene, *replica, 4);
    session->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{4});
  };

  EXPECT_EQ(server->end(SIGKILL), -SIGKILL);
  ASSERT_TRUE(eventually([&] { return session->status().link == ServerLink::kGone; }));
  EXPECT_EQ(session->status().text, "server gone: tracking on the replica");
  EXPECT_EQ(session->snapshot(), replica);
  make_offer();
  EXPECT_EQ(session->status().spooled, 1U) << "kept for the server's return";
  EXPECT_FALSE(session->wait_until_settled(60s)) << "returns at once: the server is lost";

  server = std::make_unique<ServerProcess>(domain);
  ASSERT_TRUE(eventually([&] { return session->status().link == ServerLink::kRestarted; }))
      << session->status().text;
  EXPECT_TRUE(session->status().text.starts_with("server restarted without this map"))
      << session->status().text;
  EXPECT_FALSE(session->status().map_known);
  EXPECT_EQ(session->snapshot(), replica) << "the replica is kept";
  EXPECT_EQ(session->status().spooled, 0U);
  make_offer();
  const auto replies = session->take_offer_replies();
  ASSERT_EQ(replies.size(), 2U) << "the spooled offer and the new one";
  for (const OfferReply& reply : replies) EXPECT_EQ(reply.reason, "server restarted without this map");

  session->leave_map();
  EXPECT_EQ(session->status().link, ServerLink::kConnected);
  session->send_seed(testing::make_seed(scene));
  ASSERT_TRUE(session->wait_until_settled(60s)) << "a new map on the new server";
  EXPECT_NE(session->snapshot()->epoch, replica->epoch) << "in lockstep the same seed gives the same id";
  EXPECT_TRUE(session->status().map_known);
  EXPECT_EQ(server->end(SIGTERM), 0) << "an orderly end";
}

TEST(ServerRestart, AServerThatComesLaterIsFound) {
  const testing::Scene scene(11);
  int domain = 0;
  {
    const ServerProcess probe;  // a domain that is free
    domain = probe.domain();
  }
  const auto session = testing::open_session(options_for(domain), scene.camera());
  EXPECT_FALSE(session->wait_for_server(500ms));
  EXPECT_EQ(session->status().link, ServerLink::kConnecting);
  session->send_seed(testing::make_seed(scene));  // waits for a server, too
  const ServerProcess server(domain);
  EXPECT_TRUE(session->wait_for_server(60s));
  EXPECT_TRUE(session->wait_until_settled(60s));
  EXPECT_NE(session->snapshot(), nullptr);
}

TEST(ServerProcess, EndsInAnOrderlyWayOnEachSignal) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    ServerProcess server;
    EXPECT_EQ(server.end(signal), 0) << signal;
  }
}

TEST(ServerProcess, ASecondServerInTheDomainIsRefused) {
  const ServerProcess first;
  ServiceOptions options;
  options.domain = first.domain();
  const auto second = Service::start(options, null_logger());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kRefused);
}

}  // namespace
}  // namespace cairn
