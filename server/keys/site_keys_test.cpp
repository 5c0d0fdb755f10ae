// SPDX-License-Identifier: Apache-2.0
#include "server/keys/site_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

class SiteKeysTest : public ::testing::Test {
 protected:
  void write(const std::string& text) const { std::ofstream(file_) << text; }
  void add(IdentityRole role, const std::string& name, bool is_revoked, Duty duty = Duty::kWatch) {
    Identity identity;
    identity.role = role;
    identity.name = name;
    identity.duty = duty;
    if (is_revoked) identity.revoked = Timestamp{1'800'000'000'000'000'000};
    identities_[{role, name}] = identity;
    write(to_text(identities_));
  }

  const TestDirectory folder_;
  const std::filesystem::path file_ = folder_.path() / kRegisterFile;
  Register identities_;
};

TEST_F(SiteKeysTest, GoByRoleAndName) {
  add(IdentityRole::kClient, "phone-1", true);
  add(IdentityRole::kOperator, "ann", false, Duty::kCurate);
  const SiteKeys keys = SiteKeys::read(folder_.path()).value();
  EXPECT_TRUE(keys.is_secured());
  EXPECT_TRUE(keys.is_revoked(IdentityRole::kClient, "phone-1"));
  EXPECT_FALSE(keys.is_revoked(IdentityRole::kRig, "phone-1"));
  EXPECT_FALSE(keys.is_revoked(IdentityRole::kClient, "nobody"));
  EXPECT_EQ(keys.duty_of("ann"), Duty::kCurate);
  EXPECT_EQ(keys.duty_of("phone-1"), std::nullopt);
}

TEST_F(SiteKeysTest, SayWhichClientsHaveKeysAndTheirGroups) {
  add(IdentityRole::kClient, "phone-1", true);
  add(IdentityRole::kOperator, "ann", false);
  identities_[{IdentityRole::kClient, "hand-9"}] = {.role = IdentityRole::kClient,
                                                    .name = "hand-9",
                                                    .groups = {"crew"},
                                                    .rig = {},
                                                    .wearer = {},
                                                    .issues = {},
                                                    .revoked = {}};
  add(IdentityRole::kClient, "phone-2", false);
  const SiteKeys keys = SiteKeys::read(folder_.path()).value();
  using Groups = std::map<std::string, std::set<std::string>>;
  EXPECT_EQ(keys.groups_of_clients(), (Groups{{"hand-9", {"crew"}}, {"phone-2", {}}}));
}

TEST_F(SiteKeysTest, AnOpenSiteTurnsNobodyAway) {
  SiteKeys keys;
  EXPECT_FALSE(keys.is_secured());
  EXPECT_FALSE(keys.is_revoked(IdentityRole::kClient, "phone-1"));
  EXPECT_FALSE(keys.look().value());
}

TEST_F(SiteKeysTest, AChangeIsSeenAndWhatCannotBeReadChangesNothing) {
  add(IdentityRole::kClient, "phone-1", false);
  SiteKeys keys = SiteKeys::read(folder_.path()).value();
  EXPECT_FALSE(keys.look().value());
  add(IdentityRole::kClient, "phone-1", true);
  EXPECT_TRUE(keys.look().value());
  EXPECT_TRUE(keys.is_revoked(IdentityRole::kClient, "phone-1"));
  EXPECT_FALSE(keys.look().value());
  const std::string good = to_text(identities_);
  for (const std::string& damaged : {std::string(), good.substr(0, good.size() / 2)}) {
    write(damaged);
    for (int i = 0; i < 2; ++i) {
      const auto looked = keys.look();
      ASSERT_FALSE(looked);
      EXPECT_THAT(looked.error().message, HasSubstr(file_.string()));
      EXPECT_TRUE(keys.is_revoked(IdentityRole::kClient, "phone-1"));
    }
  }
  std::filesystem::remove(file_);
  EXPECT_FALSE(keys.look());
  EXPECT_TRUE(keys.is_revoked(IdentityRole::kClient, "phone-1"));
  write(good);
  EXPECT_FALSE(keys.look().value()) << "nobody else has keys";
}

TEST_F(SiteKeysTest, AServerWithoutARegisterIsToldWhichFileIsMissing) {
  const auto missing = SiteKeys::read("/nonexistent");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(missing.error().message, HasSubstr("/nonexistent/identities.json"));
}

}  // namespace
}  // namespace cairn
