// SPDX-License-Identifier: Apache-2.0
// Maps that their makers lost at once and left: who decides is YoungMaps, and here it is carried out.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/admin/admin_client.h"
#include "tests/integration/label_fixture.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using testing::eventually;
using ::testing::UnorderedElementsAreArray;

class DroppedMaps : public testing::LabelFixture {
 protected:
  DroppedMaps() : LabelFixture(1s) { connect(); }
  void connect() {
    AdminClientOptions connection;
    connection.domain = service_options_.domain;
    auto admin = AdminClient::connect(connection);
    if (!admin) throw std::runtime_error(admin.error().message);
    admin_.emplace(std::move(*admin));
  }
  /// Its id.
  std::string make_and(const std::function<void()>& use_it = [] {}) {
    make_map();
    use_it();
    anna_->leave_map();
    return to_hex(map_.bytes);
  }
  /// `list`: maps or deleted.
  [[nodiscard]] Texts ids(const char* list) {
    const auto maps = admin_->maps();
    Texts found;
    for (const nlohmann::json& map : maps.value_or(nlohmann::json()).value(list, nlohmann::json::array()))
      found.push_back(map.at("id"));
    return found;
  }
  [[nodiscard]] bool grow() {
    testing::Frame frame = testing::make_offer(scene_, *anna_->snapshot(), 5);
    anna_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{5});
    std::vector<OfferReply> replies;
    return eventually([&] { return !(replies = anna_->take_offer_replies()).empty(); }) &&
           replies.front().accepted;
  }

  std::optional<AdminClient> admin_;
};

TEST_F(DroppedMaps, OneThatIsOfNoUseGoesAndCanBeHadBack) {
  const std::string dead = make_and();
  EXPECT_TRUE(eventually([&] { return ids("maps").empty(); }));
  EXPECT_THAT(ids("deleted"), ElementsAre(dead));
  ASSERT_TRUE(admin_->ask({{"verb", "undelete"}, {"map", dead}}));

  const std::string next = make_and();
  EXPECT_TRUE(eventually([&] { return ids("deleted") == Texts{next}; }));
  // It is served until the disk has it among the deleted.
  EXPECT_TRUE(eventually([&] { return ids("maps") == Texts{dead}; })) << "what somebody has had back stays";
}

TEST_F(DroppedMaps, OneThatIsNamedLabelledOrGrownStays) {
  const Texts of_use{
      make_and([&] {
        ASSERT_TRUE(admin_->ask({{"verb", "rename"}, {"map", to_hex(map_.bytes)}, {"name", "desk"}}));
      }),
      make_and([&] { ASSERT_NE(add(*anna_, "kettle"), LabelId{}); }),
      make_and([&] { ASSERT_TRUE(grow()); }),
  };
  const std::string dead = make_and();  // the last that is left, so the others' time has come before
  EXPECT_TRUE(eventually([&] { return !ids("deleted").empty(); }));
  EXPECT_THAT(ids("deleted"), ElementsAre(dead));
  // It is served until the disk has it among the deleted.
  EXPECT_TRUE(eventually([&] { return ids("maps").size() <= of_use.size(); }));
  EXPECT_THAT(ids("maps"), UnorderedElementsAreArray(of_use));
}

TEST_F(DroppedMaps, WhatARestartFindsStays) {
  make_map();
  const std::string dead = to_hex(map_.bytes);
  admin_.reset();
  service_.reset();
  start_service_again();
  connect();
  anna_->leave_map();
  const std::string next = make_and();
  EXPECT_TRUE(eventually([&] { return ids("deleted") == Texts{next}; }));
  EXPECT_TRUE(eventually([&] { return ids("maps") == Texts{dead}; }))
      << "nothing is known of how it was lost";
}

}  // namespace
}  // namespace cairn
