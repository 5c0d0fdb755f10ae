// SPDX-License-Identifier: Apache-2.0
#include "server/service/site_access.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <deque>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/io/test_directory.h"
#include "server/service/by_hand.h"
#include "server/store/sqlite.h"

namespace cairn {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int64_t kSecond = 1'000'000'000;
const MapId kDesk{{1}};

/// A site whose tasks run when the test says, by a clock of its own.
class SiteAccessTest : public ::testing::Test {
 protected:
  [[nodiscard]] std::unique_ptr<SiteAccess> open(const std::filesystem::path& folder,
                                                 SiteKind kind = SiteKind::kOpen) {
    auto site = SiteAccess::open(
        folder, kind, [this] { return now_; }, null_logger());
    if (!site) throw std::runtime_error(site.error().message);
    (*site)->run_by({executor_, [this](Task task) { service_.submit(std::move(task)); }});
    return std::move(*site);
  }
  void run() {
    while (!of_executor_.empty() || !of_service_.empty())
      (of_executor_.empty() ? of_service_ : of_executor_).run_one();
  }
  void put(SiteAccess* site, const json& request) {
    const auto asks = read_admin_request(request.dump());
    ASSERT_TRUE(asks && std::holds_alternative<asked::ChangeRights>(asks->what)) << request;
    auto change = change_rights(
        site->rights(), std::get<asked::ChangeRights>(asks->what), "ann",
        [](const std::string&) {
          return NamedMap{kDesk, "desk", {}};
        },
        now_);
    ASSERT_TRUE(change) << change.error().message;
    site->put(std::move(*change), [this](const Status& kept) { kept_.push_back(kept.has_value()); });
  }
  void change_file(const char* sql) const {
    auto database = sqlite::Database::open(folder_ / "site.db", sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(database);
    ASSERT_TRUE(database->execute(sql));
  }
  [[nodiscard]] Right right(const SiteAccess& site) const {
    return site.policy()->in_map(client_principal("bob"), kDesk).right;
  }
  [[nodiscard]] std::vector<std::string> audit(SiteAccess* site) {
    std::vector<std::string> lines;
    site->find({}, [&](const Result<std::vector<AuditEntry>>& found) {
      for (const AuditEntry& e : *found) lines.push_back(e.who + " " + e.action + " " + e.outcome);
    });
    run();
    return lines;
  }

  TestDirectory directory_;
  const std::filesystem::path& folder_ = directory_.path();
  Timestamp now_{1'800'000'000 * kSecond};
  TasksByHand of_executor_;
  TasksByHand of_service_;
  ByHand executor_{&of_executor_};
  ByHand service_{&of_service_};
  std::vector<bool> kept_;
  std::vector<std::string> audit_;
};

TEST_F(SiteAccessTest, ARightIsInForceOnceItIsKeptAndAfterTheNextStart) {
  {
    const auto site = open(folder_);
    EXPECT_EQ(right(*site), Right::kWrite) << "of a site that has decided nothing";
    put(site.get(), {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "read"}});
    EXPECT_EQ(right(*site), Right::kWrite) << "not kept yet";
    run();
    EXPECT_EQ(right(*site), Right::kRead);
    EXPECT_THAT(kept_, testing::ElementsAre(true));
  }
  const auto site = open(folder_);
  EXPECT_EQ(right(*site), Right::kRead);
  EXPECT_THAT(audit(site.get()), testing::ElementsAre("operator ann rights grant done"));
}

TEST_F(SiteAccessTest, ChangesThatFollowEachOtherAreAllThere) {
  const auto site = open(folder_);
  put(site.get(), {{"verb", "rights-default"}, {"right", "none"}});
  put(site.get(), {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "add"}});
  run();
  EXPECT_EQ(right(*site), Right::kAdd);
  EXPECT_EQ(site->policy()->in_map(client_principal("eve"), kDesk).right, Right::kNone);
}

/// A change that was made of one that is not kept is not kept either: else what has failed would come with
/// it, and a later one would take it back.
TEST_F(SiteAccessTest, WhatFollowsAChangeThatIsNotKeptIsNotKeptAndWhatIsAskedAfterwardsIs) {
  const auto site = open(folder_);
  put(site.get(), {{"verb", "rights-default"}, {"right", "read"}});
  run();
  auto database = sqlite::Database::open(folder_ / "site.db", sqlite::OpenMode::kReadWrite);
  ASSERT_TRUE(database);
  ASSERT_TRUE(database->execute("ALTER TABLE rights RENAME TO away"));
  put(site.get(), {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "write"}});
  put(site.get(), {{"verb", "client-block"}, {"client", "eve"}});
  of_executor_.run_one();
  ASSERT_TRUE(database->execute("ALTER TABLE away RENAME TO rights"));
  of_executor_.run_one();
  of_service_.run_one();  // the grant was not kept
  put(site.get(), {{"verb", "rights-grant"}, {"to", "zoe"}, {"map", "desk"}, {"right", "add"}});
  run();
  EXPECT_EQ(kept_, (std::vector<bool>{true, false, false, true}));
  EXPECT_EQ(right(*site), Right::kRead);
  EXPECT_EQ(site->policy()->in_map(client_principal("zoe"), kDesk).right, Right::kAdd);
  EXPECT_EQ(site->rights().table(), site->policy()->rights().table());
}

TEST_F(SiteAccessTest, AChangeWaitsForNoneOfTheQuestionsAboutTheAuditLogThatWait) {
  const auto site = open(folder_);
  for (int i = 0; i < 3; ++i) site->find({}, [](const Result<std::vector<AuditEntry>>&) {});
  site->note({0, now_, "operator ann", "map rename", "desk", "done"});
  put(site.get(), {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "read"}});
  of_executor_.run_one();
  of_executor_.run_one();
  while (!of_service_.empty()) of_service_.run_one();
  EXPECT_EQ(right(*site), Right::kRead);
  EXPECT_THAT(audit(site.get()),
              testing::ElementsAre("operator ann rights grant done", "operator ann map rename done"));
}

TEST_F(SiteAccessTest, AGrantThatExpiresIsToldOnce) {
  const auto site = open(folder_);
  put(site.get(),
      {{"verb", "rights-grant"}, {"to", "bob"}, {"map", "desk"}, {"right", "read"}, {"until", "2027-01-16"}});
  run();
  EXPECT_FALSE(site->has_changed());
  now_.nanoseconds += 86'400 * kSecond;
  EXPECT_TRUE(site->has_changed());
  EXPECT_FALSE(site->has_changed());
  EXPECT_EQ(right(*site), Right::kWrite);
}

TEST_F(SiteAccessTest, GroupsOfKeysCountAtOnceAndAlsoOnceAChangeThatWasUnderWayIsKept) {
  const auto site = open(folder_, SiteKind::kSecured);
  put(site.get(), {{"verb", "rights-grant"}, {"to", "group crew"}, {"map", "desk"}, {"right", "read"}});
  run();
  EXPECT_EQ(right(*site), Right::kNone);
  site->know_clients(GroupsOfClients{{"bob", {"crew"}}});
  EXPECT_EQ(right(*site), Right::kRead);
  EXPECT_TRUE(site->has_changed());
  EXPECT_FALSE(site->has_changed());
  put(site.get(), {{"verb", "rights-grant"}, {"to", "group crew"}, {"map", "desk"}, {"right", "add"}});
  site->know_clients(GroupsOfClients{{"bob", {}}});
  EXPECT_EQ(right(*site), Right::kNone);
  run();
  EXPECT_EQ(right(*site), Right::kNone) << "of the keys of before";
  site->know_clients(GroupsOfClients{{"bob", {"crew"}}});
  EXPECT_EQ(right(*site), Right::kAdd);
}

TEST_F(SiteAccessTest, AStoreOfAnotherSiteIsToldOnceWithTheRemedy) {
  std::ostringstream said;
  const auto start = [&](const char* authority) {
    said.str("");
    auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(said);
    auto site = SiteAccess::open(
        folder_, SiteKind::kSecured, [this] { return now_; }, std::make_shared<spdlog::logger>("", sink));
    ASSERT_TRUE(site);
    EXPECT_TRUE((*site)->know_authority(authority));
    (*site)->run_by({executor_, [this](Task task) { service_.submit(std::move(task)); }});
    audit_ = audit(site->get());
  };
  start("aaaa");
  EXPECT_THAT(said.str(), Not(HasSubstr("another site"))) << "the first that it sees";
  start("aaaa");
  EXPECT_THAT(said.str(), Not(HasSubstr("another site")));
  start("bbbb");
  EXPECT_THAT(said.str(), HasSubstr("the store belongs to another site"));
  EXPECT_THAT(said.str(), HasSubstr("`cairnctl rights`"));
  EXPECT_THAT(audit_.front(), HasSubstr("server other keys"));
  start("bbbb");
  EXPECT_THAT(said.str(), Not(HasSubstr("another site"))) << "once";
  start("aaaa");
  EXPECT_THAT(said.str(), HasSubstr("another site"));
  change_file("UPDATE authority SET data = x'616c6c'");
  start("bbbb");
  EXPECT_THAT(said.str(), HasSubstr("with whose keys the store was used last cannot be read"));
  EXPECT_THAT(audit_.front(), HasSubstr("server keys unknown"));
  start("aaaa");
  EXPECT_THAT(said.str(), HasSubstr("another site")) << "it is known again";
}

TEST_F(SiteAccessTest, RightsThatCannotBeReadCloseTheSiteAlsoAtTheNextStart) {
  {
    const auto site = open(folder_);
    put(site.get(), {{"verb", "rights-default"}, {"right", "write"}});
    run();
  }
  change_file("UPDATE rights SET data = x'616c6c'");
  {
    const auto site = open(folder_);
    EXPECT_EQ(right(*site), Right::kNone);
    EXPECT_THAT(site->trouble(), HasSubstr("nobody may do anything until"));
  }
  const auto site = open(folder_);
  EXPECT_EQ(right(*site), Right::kNone);
  put(site.get(), {{"verb", "rights-default"}, {"right", "write"}, {"create", true}});
  run();
  EXPECT_EQ(right(*site), Right::kWrite);
  EXPECT_TRUE(site->trouble().empty());
}

TEST_F(SiteAccessTest, AStoreThatWasOpenLetsNobodyInUnnamedOnceItIsSecured) {
  const auto may_create = [](const SiteAccess& site) {
    return site.policy()->on_creating(client_principal("eve")).right == Right::kWrite;
  };
  {
    const auto site = open(folder_);
    put(site.get(), {{"verb", "rights-default"}, {"right", "write"}, {"create", true}});
    put(site.get(), {{"verb", "rights-grant"}, {"to", "everyone"}, {"map", "all"}, {"right", "manage"}});
    put(site.get(), {{"verb", "rights-create"}, {"to", "everyone"}, {"may", true}});
    put(site.get(), {{"verb", "rights-grant"}, {"to", "ann"}, {"map", "desk"}, {"right", "read"}});
    run();
    EXPECT_EQ(right(*site), Right::kManage);
    EXPECT_TRUE(may_create(*site));
    EXPECT_EQ(site->secured_since(), std::nullopt);
  }
  const Timestamp secured = now_;
  for (int start = 0; start < 2; ++start) {
    const auto site = open(folder_, SiteKind::kSecured);
    EXPECT_EQ(site->secured_since(), secured);
    EXPECT_EQ(right(*site), Right::kNone);
    EXPECT_FALSE(may_create(*site));
    EXPECT_EQ(site->policy()->in_map(client_principal("ann"), kDesk).right, Right::kRead);
    EXPECT_THAT(audit(site.get()).front(), HasSubstr("server site secured default: none, makes no maps; 1 "
                                                     "grants to everyone and to makers of maps withdrawn, 1 "
                                                     "to named clients and groups left"));
    now_.nanoseconds += 86'400 * kSecond;
  }
  {  // what an operator of the secured site decides then is not withdrawn again
    const auto site = open(folder_, SiteKind::kSecured);
    put(site.get(), {{"verb", "rights-grant"}, {"to", "everyone"}, {"map", "all"}, {"right", "read"}});
    run();
  }
  EXPECT_EQ(right(*open(folder_, SiteKind::kSecured)), Right::kRead);
}

TEST_F(SiteAccessTest, ASecuredStoreIsNotOpenedToEverybody) {
  { const auto site = open(folder_, SiteKind::kSecured); }
  const auto refused = SiteAccess::open(
      folder_, SiteKind::kOpen, [this] { return now_; }, null_logger());
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(refused.error().message, HasSubstr("of a secured site since 2027-01-15T08:00:00Z"));
  EXPECT_THAT(refused.error().message, HasSubstr("start the server with --security DIR"));
  EXPECT_EQ(right(*open(folder_, SiteKind::kSecured)), Right::kNone);
}

TEST_F(SiteAccessTest, DamagedRightsOfASecuredSiteCloseItAndLeaveItSecured) {
  { const auto site = open(folder_, SiteKind::kSecured); }
  std::ofstream(folder_ / "site.db") << "nothing that a database would say, and more of that, and more";
  { const auto site = open(folder_, SiteKind::kSecured); }
  EXPECT_FALSE(SiteAccess::open(
      folder_, SiteKind::kOpen, [this] { return now_; }, null_logger()));
}

/// Served openly, anybody could make himself its operator.
TEST_F(SiteAccessTest, AFileThatCannotSayThatItIsAnOpenSitesIsNotOpenedToEverybody) {
  { const auto site = open(folder_, SiteKind::kSecured); }
  for (const char* damage : {"UPDATE secured SET data = x'616c6c'", ""}) {
    if (*damage != '\0') {
      change_file(damage);
    } else {
      std::ofstream(folder_ / "site.db") << "nothing that a database would say, and more of that, and more";
    }
    for (int start = 0; start < 2; ++start) {
      const auto refused = SiteAccess::open(
          folder_, SiteKind::kOpen, [this] { return now_; }, null_logger());
      ASSERT_FALSE(refused);
      EXPECT_EQ(refused.error().code, ErrorCode::kDamaged);
      EXPECT_THAT(refused.error().message, HasSubstr("start the server with --security DIR"));
      EXPECT_THAT(refused.error().message, HasSubstr("move " + (folder_ / "site.db").string() + " away"));
    }
  }
  EXPECT_EQ(right(*open(folder_, SiteKind::kSecured)), Right::kNone);
}

TEST_F(SiteAccessTest, WhatTheDiskDoesNotTakeWaitsAndIsTold) {
  std::ostringstream said;
  auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(said);
  auto opened = SiteAccess::open(
      folder_, SiteKind::kOpen, [this] { return now_; }, std::make_shared<spdlog::logger>("", sink));
  ASSERT_TRUE(opened);
  SiteAccess* site = opened->get();
  site->run_by({executor_, [this](Task task) { service_.submit(std::move(task)); }});
  const auto note = [&](const char* object) {
    site->note({0, now_, "operator ann", "map rename", object, object});
    run();
  };
  note("first");
  EXPECT_EQ(site->trouble(), "");
  change_file("ALTER TABLE audit RENAME TO away");
  note("second");
  note("third");
  EXPECT_THAT(site->trouble(), HasSubstr("rights and audit log cannot be kept"));
  site->try_again();
  EXPECT_TRUE(of_executor_.empty()) << "not at once";
  change_file("ALTER TABLE away RENAME TO audit");
  now_.nanoseconds += 2 * kSecond;
  site->try_again();
  run();
  EXPECT_EQ(site->trouble(), "");
  EXPECT_THAT(audit(site),
              testing::ElementsAre("operator ann map rename third", "operator ann map rename second",
                                   "operator ann map rename first"));
  EXPECT_THAT(said.str(), HasSubstr("can be kept again"));
  now_.nanoseconds += 2 * kSecond;
  site->try_again();
  EXPECT_TRUE(of_executor_.empty()) << "nothing waits";
}

TEST_F(SiteAccessTest, AChangeThatTheDiskRefusedIsTroubleUntilTheDiskHasTakenSomething) {
  const auto site = open(folder_);
  change_file("ALTER TABLE rights RENAME TO away");
  change_file("ALTER TABLE audit RENAME TO away_too");
  put(site.get(), {{"verb", "rights-default"}, {"right", "read"}});
  run();
  EXPECT_THAT(site->trouble(), HasSubstr("rights and audit log cannot be kept"));
  for (const bool is_mended : {false, true}) {
    if (is_mended) {
      change_file("ALTER TABLE away RENAME TO rights");
      change_file("ALTER TABLE away_too RENAME TO audit");
    }
    now_.nanoseconds += 2 * kSecond;
    site->try_again();
    run();
    EXPECT_EQ(site->trouble().empty(), is_mended) << site->trouble();
  }
  EXPECT_THAT(audit(site.get()), testing::Contains("server kept again rights and audit log"));
}

TEST_F(SiteAccessTest, WithoutAStoreRightsAreInMemoryAndThereIsNoLog) {
  const auto site = open({});
  put(site.get(), {{"verb", "rights-default"}, {"right", "read"}});
  EXPECT_EQ(right(*site), Right::kRead);
  Error error;
  site->find({}, [&](const Result<std::vector<AuditEntry>>& found) { error = found.error(); });
  EXPECT_EQ(error.code, ErrorCode::kRefused);
  EXPECT_THAT(error.message, HasSubstr("no --store"));
}

}  // namespace
}  // namespace cairn
