// SPDX-License-Identifier: Apache-2.0
#include "server/access/rights_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using Kind = Subject::Kind;

constexpr int64_t kSecond = 1'000'000'000;

/// Rules of all kinds, at random.
class RandomRights {
 public:
  explicit RandomRights(unsigned seed) : random_(seed) {}

  Rights make() {
    Rights rights(right(), coin());
    for (int i = below(4); i > 0; --i) EXPECT_TRUE(rights.put_group(name(), {name(), name()}));
    for (int i = below(20); i > 0; --i) {
      const Status granted = rights.grant(grant());
      EXPECT_TRUE(granted) << granted.error().message;
    }
    for (int i = below(4); i > 0; --i) EXPECT_TRUE(rights.let_create(subject(), coin()));
    for (int i = below(4); i > 0; --i) EXPECT_TRUE(rights.freeze(map(), closure()));
    for (int i = below(4); i > 0; --i) EXPECT_TRUE(rights.block(name(), closure()));
    if (coin()) rights.welcome_proposals({}, coin());
    for (int i = below(4); i > 0; --i) rights.welcome_proposals(map(), coin());
    return rights;
  }

 private:
  int below(int n) { return std::uniform_int_distribution<int>(0, n - 1)(random_); }
  bool coin() { return below(2) == 0; }
  double number() { return std::uniform_real_distribution<double>(-10, 10)(random_); }
  Eigen::Vector3d place() { return {number(), number(), number()}; }
  Right right() { return static_cast<Right>(below(5)); }
  std::string name() { return "client-" + std::to_string(below(9)); }
  Timestamp time() { return {(1'800'000'000 + below(1'000'000)) * kSecond}; }
  Closure closure() { return {"ops", time(), coin() ? "" : "\"because\" \u00fcber"}; }
  MapId map() {
    MapId id;
    for (auto& byte : id.bytes) byte = static_cast<uint8_t>(below(256));
    return id;
  }
  Subject subject() {
    const auto kind = static_cast<Kind>(below(3));
    return {kind, kind == Kind::kEveryone ? "" : name()};
  }
  Extent extent() {
    if (coin()) return Sphere{place(), 0.1 + std::abs(number())};
    const Eigen::Vector3d corner = place();
    return Box{corner, corner + Eigen::Vector3d(1, 2, 3)};
  }
  Grant grant() {
    Grant grant{subject(), {}, right(), {}, {}, "ops", time()};
    if (coin()) grant.map = map();
    if (coin()) grant.expires = time();
    if (grant.map && (grant.right == Right::kAdd || grant.right == Right::kWrite)) grant.extent = extent();
    return grant;
  }

  std::mt19937 random_;
};

TEST(RightsFile, WhatIsWrittenIsReadBack) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  RandomRights random(seed);
  for (int i = 0; i < 100; ++i) {
    const Rights rights = random.make();
    const auto read = read_rights(to_text(rights));
    ASSERT_TRUE(read) << read.error().message << "\n" << to_text(rights);
    EXPECT_EQ(read->table(), rights.table()) << to_text(rights);
  }
}

TEST(RightsFile, IsOneLineForARule) {
  Rights rights(Right::kRead, false);
  ASSERT_TRUE(rights.put_group("crew", {"ann", "bob"}));
  ASSERT_TRUE(rights.grant({{Kind::kGroup, "crew"},
                            {},
                            Right::kWrite,
                            {},
                            Timestamp{1'800'000'000 * kSecond},
                            "ops",
                            Timestamp{1'700'000'000 * kSecond}}));
  EXPECT_EQ(to_text(rights), R"({"format": 1,
 "default": "read", "create": false,
 "groups": [
  {"group":"crew","members":["ann","bob"]}
 ],
 "grants": [
  {"to":"group crew","map":"all","right":"write","expires":"2027-01-15T08:00:00Z","by":"ops","since":"2023-11-14T22:13:20Z"}
 ],
 "creators": [],
 "frozen": [],
 "blocked": []
}
)");
}

TEST(RightsFile, WhatIsWrongIsRefusedByTheRuleThatIsWrong) {
  const std::string head = R"({"format":1,"default":"none","create":false)";
  const std::string who = R"("to":"ann","map":"all","right":"read","by":"ops","since":"2026-01-01")";
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "no JSON"},
      {"[]", "it is no object"},
      {"{", "no JSON"},
      {R"({"default":"none","create":false})", "'format' is missing"},
      {R"({"format":2,"default":"none","create":false})", "install a newer version"},
      {R"({"format":1,"default":"all","create":false})", "no right is called 'all'"},
      {R"({"format":1,"default":"none","create":1})", "'create' is missing or neither true nor false"},
      {head + R"(,"grant":[]})", "unknown key 'grant'"},
      {head + R"(,"grants":{}})", "'grants' is no list"},
      {head + R"(,"grants":[{)" + who + "},{" + who + R"(,"x":1}]})", "'grants', rule 2: unknown key 'x'"},
      {head + R"(,"grants":[{)" + who + R"(,"expires":"3000-01-01"}]})", "'3000-01-01' is no time"},
      {head + R"(,"grants":[{)" + who + R"(,"within":{"center":[0,0,1e999],"radius":1}}]})", "no JSON"},
      {head + R"(,"grants":[{)" + who + R"(,"within":{"center":[0,0],"radius":1}}]})", "three numbers"},
      {head + R"(,"grants":[{"to":"ann","map":"desk","right":"read","by":"o","since":"2026-01-01"}]})",
       "'desk'"},
      {head + R"(,"groups":[{"group":"crew","members":["A"]}]})", "'groups', rule 1: 'A' can be no client"},
      {head + R"(,"frozen":[{"map":"00","by":"o","since":"2026-01-01"}]})", "'frozen', rule 1"},
      {head + R"(,"x":)" + std::string(100, '[') + std::string(100, ']') + "}", "nested too deeply"},
  };
  for (const auto& [text, why] : cases) {
    const auto read = read_rights(text);
    ASSERT_FALSE(read) << text;
    EXPECT_EQ(read.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(read.error().message, HasSubstr(why)) << text;
  }
}

/// Whatever is done to a text, it is read or refused.
TEST(RightsFile, DamageIsRefusedOrReadAndNeverMore) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const std::string whole = to_text(RandomRights(seed).make());
  for (int i = 0; i < 2000; ++i) {
    std::string text = whole;
    for (int changes = 1 + static_cast<int>(random() % 4); changes > 0; --changes)
      text[random() % text.size()] = static_cast<char>(random() % 256);
    const auto read = read_rights(text);
    if (read) {
      EXPECT_TRUE(read_rights(to_text(*read)));
    }
  }
}

}  // namespace
}  // namespace cairn
