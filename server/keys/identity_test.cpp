// SPDX-License-Identifier: Apache-2.0
#include "server/keys/identity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;

constexpr Timestamp kNow{1'800'000'000'000'000'000};

Register some_identities() {
  Register all;
  Identity phone;
  phone.name = "phone-1";
  phone.groups = {"crew", "visitors"};
  phone.rig = "shoulder";
  phone.wearer = "ann";
  phone.issues = {{"0A1B", kNow}, {"FF", kNow + std::chrono::hours(1)}};
  phone.revoked = kNow;
  all[{phone.role, phone.name}] = phone;
  Identity ann;
  ann.role = IdentityRole::kOperator;
  ann.name = "ann";
  ann.duty = Duty::kCurate;
  all[{ann.role, ann.name}] = ann;
  return all;
}

TEST(RegisterTest, WhatIsWrittenIsReadBack) {
  const Register all = some_identities();
  const auto again = parse_register(to_text(all));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(*again, all);
  EXPECT_TRUE(parse_register(to_text({}))->empty());
}

TEST(RegisterTest, DamageIsRefusedWithWhatIsWrong) {
  const auto error_of = [](const std::string& rows) {
    const auto read = parse_register("{\"format\": 1, \"identities\": [" + rows + "]}");
    return read ? "taken" : read.error().message;
  };
  const std::string good = R"({"role": "rig", "name": "a", "issues": []})";
  EXPECT_EQ(error_of(good), "taken");
  EXPECT_THAT(error_of(good + "," + good), HasSubstr("identity 2: is there twice"));
  EXPECT_THAT(error_of(R"({"role": "king", "name": "a", "issues": []})"), HasSubstr("'king'"));
  EXPECT_THAT(error_of(R"({"role": "rig", "name": "../a", "issues": []})"), HasSubstr("'../a' is no name"));
  EXPECT_THAT(error_of(R"({"role": "rig", "name": "a", "revocked": "", "issues": []})"),
              HasSubstr("'revocked'"));
  EXPECT_THAT(error_of(R"({"role": "rig", "name": "a", "revoked": "soon", "issues": []})"),
              HasSubstr("soon"));
  EXPECT_THAT(
      error_of(R"({"role": "rig", "name": "a", "issues": [{"serial": "x", "expires": "2030-01-01"}]})"),
      HasSubstr("'x' is no serial number"));
  EXPECT_NE(error_of("1"), "taken");
  EXPECT_NE(error_of("{}"), "taken");
  EXPECT_FALSE(parse_register("{\"format\": 2, \"identities\": []}"));
  EXPECT_FALSE(parse_register("{\"format\": 1"));
  const std::string whole = to_text(some_identities());
  for (size_t size = 0; size + 2 < whole.size(); ++size)
    EXPECT_FALSE(parse_register(whole.substr(0, size))) << size;
}

}  // namespace
}  // namespace cairn
