// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/doorkeeper.h"

#include <gtest/gtest.h>

#include <fstream>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr MonotonicTime kStart{seconds(1000)};

class DoorkeeperTest : public ::testing::Test {
 protected:
  DoorkeeperTest() { write(false); }
  void write(bool is_revoked) const {
    Register all;
    Identity phone;
    phone.name = "phone-1";
    phone.wearer = "ada";
    if (is_revoked) phone.revoked = Timestamp{1'800'000'000'000'000'000};
    all[{phone.role, phone.name}] = phone;
    Identity ann;
    ann.role = IdentityRole::kOperator;
    ann.name = "ann";
    ann.duty = Duty::kCurate;
    all[{ann.role, ann.name}] = ann;
    std::ofstream(folder_.path() / kRegisterFile) << to_text(all);
  }
  const TestDirectory folder_;
};

TEST_F(DoorkeeperTest, InAnOpenSiteANameIsAClaimAndAnOperatorMayDoAll) {
  Doorkeeper door({}, null_logger());
  EXPECT_EQ(door.client("phone-1"), client_principal("phone-1"));
  EXPECT_EQ(door.operator_of("ann"),
            operator_principal("ann", Principal::Proof::kClaimed, Duty::kAdminister));
  EXPECT_EQ(door.operator_of("ann").duty, Duty::kAdminister);
  EXPECT_EQ(door.wearer_of("phone-1", "bob"), "bob");
  EXPECT_FALSE(door.look(kStart));
  EXPECT_EQ(door.next_look(), MonotonicTime::max());
}

TEST_F(DoorkeeperTest, InASecuredSiteANameIsProvenAndARoleIsThatOfTheRegister) {
  Doorkeeper door(SiteKeys::read(folder_.path()).value(), null_logger());
  EXPECT_EQ(door.client("phone-1").proof, Principal::Proof::kProven);
  EXPECT_EQ(door.operator_of("ann"),
            (Principal{Principal::Kind::kOperator, "ann", Principal::Proof::kProven, Duty::kCurate}));
  EXPECT_EQ(door.operator_of("nobody").duty, Duty::kWatch) << "whom the register does not know";
  EXPECT_EQ(door.wearer_of("phone-1", "bob"), "ada");
  EXPECT_EQ(door.wearer_of("phone-2", "ada"), "");
}

TEST_F(DoorkeeperTest, AnOperatorIsKnownAsSoonAsItHasKeys) {
  std::ofstream(folder_.path() / kRegisterFile) << to_text({});
  Doorkeeper door(SiteKeys::read(folder_.path()).value(), null_logger());
  EXPECT_FALSE(door.look(kStart));
  EXPECT_EQ(door.operator_of("ann").duty, Duty::kWatch);
  write(true);
  EXPECT_EQ(door.operator_of("ann").duty, Duty::kCurate);
  EXPECT_TRUE(door.look(door.next_look())) << "and who was revoked with it is not forgotten";
}

TEST_F(DoorkeeperTest, WhoIsRevokedIsTurnedAwayWithinASecondAndThatIsToldNowAndThen) {
  Doorkeeper door(SiteKeys::read(folder_.path()).value(), null_logger());
  EXPECT_FALSE(door.look(kStart));
  EXPECT_FALSE(door.is_turned_away(IdentityRole::kClient, "phone-1"));
  write(true);
  EXPECT_FALSE(door.look(kStart)) << "not yet";
  EXPECT_LE(door.next_look(), kStart + seconds(1));
  EXPECT_TRUE(door.look(door.next_look()));
  EXPECT_TRUE(door.is_turned_away(IdentityRole::kClient, "phone-1"));
  EXPECT_EQ(door.clients_turned_away(), std::set<std::string>{"phone-1"});
  const auto said = [&](IdentityRole role, MonotonicTime now) {
    return door.note_try(role, "phone-1", {}, now);
  };
  EXPECT_EQ(said(IdentityRole::kClient, kStart), Doorkeeper::kRevoked);
  for (int second = 1; second < 60; ++second)
    EXPECT_FALSE(said(IdentityRole::kClient, kStart + seconds(second)));
  EXPECT_TRUE(said(IdentityRole::kOperator, kStart));
  EXPECT_EQ(said(IdentityRole::kClient, kStart + seconds(60)),
            std::string(Doorkeeper::kRevoked) + "; 59 messages of it were passed over meanwhile");
}

TEST_F(DoorkeeperTest, WhomTheMiddlewareDoesNotLetInIsToldNowAndThenAndOfFew) {
  const auto refused = std::make_shared<wire::RefusedPeers>();
  Doorkeeper door(SiteKeys::read(folder_.path()).value(), null_logger(), refused);
  const auto try_as = [&](int phone) {
    refused->note("error: certificate revoked; subject: /OU=client/CN=phone-" + std::to_string(phone));
  };
  try_as(1);
  const auto told = door.refused_to_be_told(kStart);
  ASSERT_EQ(told.size(), 1U);
  EXPECT_EQ(told[0].who, "somebody as client phone-1");
  try_as(1);
  EXPECT_TRUE(door.refused_to_be_told(kStart + seconds(59)).empty());
  try_as(1);
  EXPECT_EQ(door.refused_to_be_told(kStart + seconds(60)).size(), 1U);
  size_t many = 0;
  for (int phone = 2; phone < 500; ++phone) {
    try_as(phone);
    many += door.refused_to_be_told(kStart + seconds(61)).size();
  }
  EXPECT_LT(many, 50U);
  try_as(1000);
  EXPECT_EQ(door.refused_to_be_told(kStart + seconds(200)).size(), 1U);
  try_as(1000);
  door.came(7, "host a", kStart + seconds(210));
  const auto again = door.refused_to_be_told(kStart + seconds(211));
  ASSERT_EQ(again.size(), 1U) << "with each process that comes";
  EXPECT_EQ(again[0].who, "somebody as client phone-1000");
  const auto stranger = door.refused_to_be_told(kStart + seconds(215));
  ASSERT_EQ(stranger.size(), 1U);
  EXPECT_EQ(
      stranger[0].why,
      "it has shown no keys that this server accepts; refused meanwhile: somebody as client phone-1000: "
      "its keys were revoked (host a)");
  door.came(8, "host b", kStart + seconds(400));
  const auto silent = door.refused_to_be_told(kStart + seconds(405));
  ASSERT_EQ(silent.size(), 1U);
  EXPECT_EQ(silent[0].why, "no keys of this site were shown (host b)");
  Doorkeeper open({}, null_logger(), refused);
  try_as(1);
  EXPECT_TRUE(open.refused_to_be_told(kStart).empty());
}

}  // namespace
}  // namespace cairn
