// SPDX-License-Identifier: Apache-2.0
#include "common/wire/network_path.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/wire/internal/port_holder.h"

namespace cairn::wire {
namespace {

using ::testing::HasSubstr;

ParticipantOptions client_of(const std::string& host) {
  ParticipantOptions options;
  options.server_host = host;
  options.profile = "wifi";
  return options;
}

TEST(NetworkPath, IsThatOfTheRouteToTheServer) {
  // Also where the name of this host stands for an address of the loopback network, as Debian has it.
  const auto path = find_path(client_of("127.0.1.1"));
  ASSERT_TRUE(path.has_value()) << path.error().message;
  EXPECT_EQ(path->server, "127.0.1.1");
  EXPECT_EQ(path->interface, "lo");
  EXPECT_EQ(path->address, "127.0.0.1");
  EXPECT_EQ(describe(*path), "lo (127.0.0.1)");
  EXPECT_TRUE(has_address(path->address));
  EXPECT_FALSE(has_address("192.0.2.7"));
}

TEST(NetworkPath, IsTheOneAskedForOrAllThereAreAreNamed) {
  ParticipantOptions options = client_of("192.0.2.1");
  options.listen = "lo";
  const auto by_name = find_path(options);
  options.listen = "127.0.0.1";
  ASSERT_TRUE(by_name.has_value()) << by_name.error().message;
  EXPECT_EQ(find_path(options).value(), *by_name);
  EXPECT_EQ(by_name->address, "127.0.0.1");
  for (const char* no_such : {"no-such-if", "192.0.2.7"}) {
    options.listen = no_such;
    const auto refused = find_path(options);
    ASSERT_FALSE(refused.has_value());
    EXPECT_EQ(refused.error().code, ErrorCode::kConfiguration);
    EXPECT_THAT(refused.error().message, HasSubstr(no_such));
    EXPECT_THAT(refused.error().message, HasSubstr("lo (127.0.0.1)"));
  }
}

TEST(NetworkPath, IsThatOfTheProfileWhereItNamesOne) {
  ParticipantOptions options = client_of("localhost");
  options.profile = "loopback";
  EXPECT_EQ(find_path(options).value(), (NetworkPath{"127.0.0.1", "lo", "127.0.0.1"}));
  options.role = Role::kServer;
  EXPECT_EQ(find_path(options).value(), (NetworkPath{"", "lo", "127.0.0.1"}));
}

TEST(NetworkPath, WhatIsNoHostSaysWhatToPass) {
  const auto refusal_of = [](const std::string& host) {
    const auto refused = find_path(client_of(host));
    return refused ? Error{ErrorCode::kInternal, "is taken"} : refused.error();
  };
  EXPECT_EQ(refusal_of("no-such-host.invalid").code, ErrorCode::kNoServer);
  EXPECT_THAT(refusal_of("no-such-host.invalid").message, HasSubstr("no-such-host.invalid"));
  for (const char* address : {"::1", "fe80::1%lo", "[2001:db8::1]"}) {
    EXPECT_EQ(refusal_of(address).code, ErrorCode::kUsage);
    EXPECT_THAT(refusal_of(address).message, HasSubstr("IPv6"));
  }
  EXPECT_EQ(refusal_of("10.77.0.1:7410").code, ErrorCode::kUsage);
  EXPECT_THAT(refusal_of("10.77.0.1:7410").message, HasSubstr("--domain"));
  for (const char* list : {"10.77.0.1,10.77.0.2", "desk-pc lab-pc", "::1;::2"}) {
    EXPECT_EQ(refusal_of(list).code, ErrorCode::kUsage);
    EXPECT_THAT(refusal_of(list).message, HasSubstr("pass one host"));
  }
}

TEST(NetworkPath, SeveralInterfacesAreRefusedWithWhatToPass) {
  ParticipantOptions options = client_of("localhost");
  for (const Role role : {Role::kServer, Role::kClient}) {
    options.role = role;
    for (const char* list : {"lo,eth0", "127.0.0.1 10.77.0.1"}) {
      options.listen = list;
      const auto refused = find_path(options);
      ASSERT_FALSE(refused);
      EXPECT_EQ(refused.error().code, ErrorCode::kUsage);
      EXPECT_THAT(refused.error().message, HasSubstr("pass its name or IPv4 address"));
    }
  }
}

TEST(NetworkPath, ThisHostHasTheLoopbackProfile) {
  EXPECT_EQ(default_profile("localhost"), "loopback");
  EXPECT_EQ(default_profile("127.0.1.1"), "loopback");
  EXPECT_EQ(default_profile("10.77.0.1"), "wifi");
  EXPECT_EQ(default_profile("127.example.org"), "wifi");
}

TEST(PortHolder, IsTheProgramThatHasThePort) {
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t length = sizeof(address);
  ASSERT_EQ(bind(fd, reinterpret_cast<const sockaddr*>(&address), length), 0);
  ASSERT_EQ(getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length), 0);
  const uint16_t port = ntohs(address.sin_port);
  EXPECT_TRUE(internal::port_is_taken(port));
  const auto holder = internal::find_port_holder(port);
  close(fd);
  ASSERT_TRUE(holder.has_value());
  EXPECT_EQ(holder->process, getpid());
  EXPECT_THAT(holder->program, HasSubstr("wire"));
}

}  // namespace
}  // namespace cairn::wire
