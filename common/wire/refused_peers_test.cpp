// SPDX-License-Identifier: Apache-2.0
#include "common/wire/refused_peers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn::wire {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;

TEST(RefusedPeers, AreReadFromWhatTheMiddlewareSays) {
  const auto revoked = refused_peer_in(
      "Begin handshake reply failed: Certificate not valid: error: certificate revoked; subject: "
      "/O=cairn/OU=client/CN=phone-1(code: 200)");
  ASSERT_TRUE(revoked);
  EXPECT_EQ(revoked->who, "somebody as client phone-1");
  EXPECT_EQ(revoked->why, "its keys were revoked");
  EXPECT_EQ(
      refused_peer_in("Process handshake failed: Certificate not valid: error: certificate has expired; "
                      "subject: /O=cairn/OU=client/CN=phone-1(code: 200)")
          ->why,
      "its certificate is not accepted: certificate has expired");
  const auto self_signed = refused_peer_in(
      "Could not get remote participant dfb5f137:1626889a:b7f96433:1c1 permissions from plugin: Failed to "
      "parse PKCS7 SMIME document: (code: 127)");
  ASSERT_TRUE(self_signed);
  EXPECT_EQ(self_signed->who, "somebody");
  EXPECT_THAT(self_signed->why, HasSubstr("permissions are not accepted"));
  for (const char* line :
       {"", "ddsi_udp_conn_write to udp/10.0.0.1:7410 failed with retcode -1", "; subjec: "})
    EXPECT_FALSE(refused_peer_in(line)) << line;
}

/// Who makes his own certificate chooses what is in it.
TEST(RefusedPeers, WhatACertificateSaysIsTakenForANameOrNotAtAll) {
  for (const char* subject :
       {"/O=cairn/OU=client/CN=", "/O=cairn/CN=phone-1", "/OU=Client/CN=UPPER", "", "/CN=/OU="})
    EXPECT_EQ(refused_peer_in(std::string("error: x; subject: ") + subject)->who, "somebody") << subject;
  const auto long_one = refused_peer_in("error: " + std::string(10'000, 'x') +
                                        "; subject: /OU=" + std::string(10'000, 'a') + "/CN=b");
  EXPECT_LT(long_one->why.size(), 200U);
  EXPECT_EQ(long_one->who, "somebody");
}

TEST(RefusedPeers, AreKeptOnceAndNotWithoutEnd) {
  RefusedPeers peers;
  for (int i = 0; i < 1000; ++i) {
    peers.note("error: certificate revoked; subject: /OU=client/CN=phone-" + std::to_string(i % 500));
    peers.note("error: certificate revoked; subject: /OU=client/CN=phone-1");
  }
  EXPECT_THAT(peers.take(), SizeIs(RefusedPeers::kMost));
  EXPECT_THAT(peers.take(), SizeIs(0));
  peers.note("error: certificate revoked; subject: /OU=client/CN=phone-1");
  EXPECT_THAT(peers.take(), SizeIs(1));
}

}  // namespace
}  // namespace cairn::wire
