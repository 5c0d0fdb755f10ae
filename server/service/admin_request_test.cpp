// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_request.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

AskedOfServer read(const std::string& text) {
  auto asks = read_admin_request(text);
  EXPECT_TRUE(asks) << text;
  return asks ? *std::move(asks) : AskedOfServer();
}

std::string why_not_read(const std::string& text) {
  const auto asks = read_admin_request(text);
  return asks ? std::string() : asks.error().message;
}

TEST(AdminRequest, WhatIsNoRequestIsToldWhy) {
  EXPECT_EQ(why_not_read("verb"), "a request that is no JSON object");
  EXPECT_EQ(why_not_read("[1]"), "a request that is no JSON object");
  EXPECT_EQ(why_not_read(std::string(20, '[')), "a request that is no JSON object");
  EXPECT_EQ(why_not_read(R"({"map": "desk"})"), "a request without 'verb', a text");
  EXPECT_EQ(why_not_read(R"({"verb": 5})"), "a request without 'verb', a text");
}

TEST(AdminRequest, IsReadAsValues) {
  const AskedOfServer asks = read(R"({"verb": "label-rename", "map": "desk", "label": 3, "text": "saw"})");
  const auto* of_map = std::get_if<asked::OfMap>(&asks.what);
  ASSERT_NE(of_map, nullptr);
  EXPECT_EQ(of_map->map, "desk");
  const auto* rename = std::get_if<asked::RenameLabel>(&of_map->what);
  ASSERT_NE(rename, nullptr);
  EXPECT_EQ(rename->label, LabelId{3});
  EXPECT_EQ(rename->text, "saw");
}

TEST(AdminRequest, AMemberOfAnotherKindIsNone) {
  const auto asks = read(R"({"verb": "import-write", "token": 7, "offset": -1})");
  const auto* piece = std::get_if<asked::ImportWrite>(&asks.what);
  ASSERT_NE(piece, nullptr);
  EXPECT_EQ(piece->token, "");
  EXPECT_EQ(piece->offset, 0);
  const auto removal = read(R"({"verb": "delete", "map": "desk", "for_good": "yes"})");
  EXPECT_FALSE(std::get<asked::Delete>(std::get<asked::OfMap>(removal.what).what).for_good);
}

TEST(AdminRequest, OfRightsAndTheAuditLogAnUnfitMemberIsNamed) {
  const auto unfit = read(R"({"verb": "rights-grant", "to": 7, "map": "desk", "right": "read"})");
  ASSERT_TRUE(std::holds_alternative<asked::Unfit>(unfit.what));
  EXPECT_EQ(std::get<asked::Unfit>(unfit.what).why.message, "'to' is no text");
  EXPECT_TRUE(unfit.is_audited()) << "what was tried is on record, too";
  const auto audit =
      read(R"({"verb": "audit", "who": "ann", "from": "2027-01-01", "before": 7, "limit": 100000})");
  ASSERT_TRUE(std::holds_alternative<asked::Audit>(audit.what));
  const AuditQuery& query = std::get<asked::Audit>(audit.what).query;
  EXPECT_EQ(query.who, "ann");
  EXPECT_EQ(query.before_number, 7);
  EXPECT_LE(query.limit, 500U);
  EXPECT_TRUE(std::holds_alternative<asked::Unfit>(read(R"({"verb": "audit", "from": "yesterday"})").what));
}

TEST(AdminRequest, WhatItTakesToAskGoesByTheVerb) {
  EXPECT_EQ(read(R"({"verb": "maps"})").act, OperatorAct::kSee);
  EXPECT_EQ(read(R"({"verb": "tags", "map": "desk"})").act, OperatorAct::kSee);
  EXPECT_EQ(read(R"({"verb": "delete", "map": "desk"})").act, OperatorAct::kChange);
  EXPECT_EQ(read(R"({"verb": "export", "map": "desk"})").act, OperatorAct::kTransfer);
  EXPECT_EQ(read(R"({"verb": "proposal-show", "proposal": "00-1"})").act, OperatorAct::kTransfer);
  EXPECT_EQ(read(R"({"verb": "verify-part", "part": "site.db"})").act, OperatorAct::kExamine);
  EXPECT_EQ(read(R"({"verb": "rights-grant"})").act, OperatorAct::kGovern);
  EXPECT_EQ(read(R"({"verb": "map-freeze", "map": "desk"})").act, OperatorAct::kChange)
      << "who looks after maps may close one to everybody";
  EXPECT_EQ(read(R"({"verb": "explode"})").act, OperatorAct::kChange);
}

TEST(AdminRequest, ChangesAreOnRecordAndPiecesAreNot) {
  EXPECT_FALSE(read(R"({"verb": "status"})").is_audited());
  EXPECT_TRUE(read(R"({"verb": "explode"})").is_audited());
  EXPECT_TRUE(read(R"({"verb": "backup"})").is_audited());
  EXPECT_FALSE(read(R"({"verb": "backup-part", "part": "site.db"})").is_audited());
  EXPECT_FALSE(read(R"({"verb": "export-read", "token": "export-1"})").is_audited());
  EXPECT_EQ(read(R"({"verb": "tag", "map": "desk", "tag": "v1", "name": ""})").object, "map desk, tag v1");
}

}  // namespace
}  // namespace cairn
