// SPDX-License-Identifier: Apache-2.0
// Maps that go while people use them: every offer is answered, and what has gone is nowhere found again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "client/session/label_request.h"
#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/io/test_directory.h"
#include "server/admin/admin_client.h"
#include "tests/integration/server_process.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::ServerProcess;

constexpr rlim_t kSmall = 200 << 10;  ///< [bytes] less than a map's file

class DeletionTest : public ::testing::Test {
 protected:
  DeletionTest() : server_(0, {"--store", folder_.path().string()}) {
    SessionOptions options;
    options.domain = server_.domain();
    options.name = "anna";
    session_ = testing::open_session(options, scene_.camera());
    AdminClientOptions connection;
    connection.domain = server_.domain();
    auto admin = AdminClient::connect(connection);
    if (!admin) throw std::runtime_error(admin.error().message);
    admin_.emplace(std::move(*admin));
  }

  void limit_files(rlim_t bytes) const {
    const rlimit limit{bytes, RLIM_INFINITY};
    ASSERT_EQ(prlimit(server_.pid(), RLIMIT_FSIZE, &limit, nullptr), 0);
  }
  [[nodiscard]] SeedReply seed() {
    EXPECT_TRUE(session_->wait_for_server(60s));
    session_->send_seed(testing::make_seed(scene_));
    std::optional<SeedReply> reply;
    EXPECT_TRUE(eventually([&] { return (reply = session_->take_seed_reply()).has_value(); }));
    return reply.value_or(SeedReply{});
  }
  void send_offer(const MapSnapshot& map, int step) {
    testing::Frame frame = testing::make_offer(scene_, map, step);
    session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
  }
  /// Where the first view of the map is said to have been taken.
  [[nodiscard]] std::vector<MapId> places() {
    FrameImages images;
    images.build_pyramid(scene_.render(testing::Scene::pose(testing::kFirstView), 0)->view());
    session_->send_query(
        std::make_shared<const PlaceView>(describe_place(images.pyramid, images.all_corners())),
        Timestamp{++asked_});
    std::optional<RelocalizationAnswer> answer;
    EXPECT_TRUE(eventually([&] { return (answer = session_->take_relocalization_answer()).has_value(); }));
    std::vector<MapId> maps;
    if (answer) {
      for (const PlaceCandidate& candidate : answer->candidates) maps.push_back(candidate.map);
    }
    return maps;
  }

  [[nodiscard]] nlohmann::json maps() { return admin_->maps().value_or(nlohmann::json()); }
  [[nodiscard]] nlohmann::json labels(const std::string& map) {
    return admin_->labels(map).value_or(nlohmann::json());
  }

  const testing::Scene scene_{11};
  const TestDirectory folder_;
  ServerProcess server_;
  std::unique_ptr<Session> session_;
  std::optional<AdminClient> admin_;
  int64_t asked_ = 0;
};

TEST_F(DeletionTest, OffersToADeletedMapAreAnsweredAndItIsNoPlaceAnyMore) {
  const SeedReply made = seed();
  ASSERT_TRUE(made.answer) << made.reason;
  ASSERT_TRUE(session_->wait_for_map(60s));
  const MapSnapshotPtr map = session_->snapshot();
  for (const int step : {4, 6, 8, 10}) send_offer(*map, step);
  const auto deleted = admin_->ask({{"verb", "delete"}, {"map", to_hex(map->map.bytes)}});
  ASSERT_TRUE(deleted) << deleted.error().message;
  for (int times = 0; times < 10; ++times) EXPECT_THAT(places(), IsEmpty());

  // The name is free, and whoever had offers out goes on elsewhere.
  session_->leave_map();
  const SeedReply next = seed();
  ASSERT_TRUE(next.answer) << next.reason;
  EXPECT_NE(next.answer->map, map->map);
  ASSERT_TRUE(session_->wait_for_map(60s));
  send_offer(*session_->snapshot(), 4);
  std::map<uint64_t, OfferReply> replies;
  ASSERT_TRUE(eventually([&] {
    for (const OfferReply& reply : session_->take_offer_replies()) replies[reply.seq] = reply;
    return replies.contains(5);
  }));
  EXPECT_TRUE(replies[5].accepted) << replies[5].reason;
  replies.erase(5);
  for (const auto& [seq, reply] : replies) {
    if (reply.accepted) continue;
    EXPECT_THAT(reply.reason, ::testing::AnyOf(HasSubstr("deleted"), HasSubstr("does not know"))) << seq;
  }
}

/// Whatever an operator asks for: what is refused has not happened, and the reason is the disk's.
TEST_F(DeletionTest, WhatTheDiskDoesNotTakeHasNotHappened) {
  const SeedReply made = seed();
  ASSERT_TRUE(made.answer) << made.reason;
  ASSERT_TRUE(session_->wait_for_map(60s));
  const std::string id = to_hex(made.answer->map.bytes);
  const SE3 camera_from_map = session_->snapshot()->find(KeyframeId{2})->camera_from_map;
  session_->send_request(*request_new_label(*session_->snapshot(), camera_from_map,
                                            camera_from_map.inverse() * Eigen::Vector3d(0, 0, 1), "vice"));
  ASSERT_TRUE(eventually([&] { return !labels(id).empty(); }));
  const auto name = [&] { return maps()["maps"].at(0).value("name", ""); };
  const std::string before = name();
  const auto expect_refused = [&](const nlohmann::json& request, const char* reason) {
    const auto refused = admin_->ask(request);
    ASSERT_FALSE(refused) << request;
    EXPECT_EQ(exit_code(refused.error().code), 3) << request << refused.error().message;
    EXPECT_THAT(refused.error().message, HasSubstr(reason)) << request;
  };

  // The folder of deleted maps takes nothing.
  const std::filesystem::path deleted = folder_.path() / "deleted";
  std::filesystem::remove(deleted);
  std::ofstream(deleted) << "no folder";
  expect_refused({{"verb", "delete"}, {"map", id}}, "Not a directory");
  ASSERT_EQ(maps()["maps"].size(), 1U);
  send_offer(*session_->snapshot(), 5);
  ASSERT_TRUE(eventually([&] {
    const auto replies = session_->take_offer_replies();
    return !replies.empty() && replies.front().accepted;
  })) << "it grows on";
  EXPECT_THAT(places(), ::testing::Contains(made.answer->map));
  std::filesystem::remove(deleted);
  std::filesystem::create_directory(deleted);

  // No file takes anything more.
  limit_files(1);
  expect_refused({{"verb", "rename"}, {"map", id}, {"name", "bench"}}, "File too large");
  EXPECT_EQ(name(), before);
  expect_refused({{"verb", "label-rename"}, {"map", id}, {"label", 1}, {"text", "saw"}}, "File too large");
  expect_refused({{"verb", "label-remove"}, {"map", id}, {"label", 1}}, "File too large");
  EXPECT_EQ(labels(id).at(0).value("text", ""), "vice");
  expect_refused({{"verb", "export"}, {"map", id}}, "File too large");
  limit_files(RLIM_INFINITY);

  ASSERT_TRUE(admin_->ask({{"verb", "delete"}, {"map", id}}));
  limit_files(1);
  expect_refused({{"verb", "undelete"}, {"map", id}}, folder_.path().c_str());
  EXPECT_THAT(maps()["maps"], IsEmpty());
  EXPECT_THAT(maps()["unloaded"], IsEmpty());
  EXPECT_EQ(maps()["deleted"].size(), 1U);
  limit_files(RLIM_INFINITY);
  const auto back = admin_->ask({{"verb", "undelete"}, {"map", id}});
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->content.value("name", ""), before);
  EXPECT_EQ(back->content.value("keyframes", 0), 3);
}

TEST_F(DeletionTest, AMapThatCannotBeKeptWasNeverThere) {
  ASSERT_TRUE(session_->wait_for_server(60s));
  limit_files(kSmall);
  for (int times = 0; times < 2; ++times) {
    const SeedReply refused = seed();
    EXPECT_FALSE(refused.answer);
    EXPECT_THAT(refused.reason, HasSubstr(folder_.path().string()));
    EXPECT_THAT(places(), IsEmpty());
  }
  const auto listed = admin_->ask({{"verb", "maps"}});
  ASSERT_TRUE(listed) << listed.error().message;
  EXPECT_THAT(listed->content["maps"], IsEmpty());
  const auto status = admin_->ask({{"verb", "status"}});
  ASSERT_TRUE(status);
  EXPECT_NE(status->content["health"], "ok") << "for as long as nothing can be kept";

  limit_files(RLIM_INFINITY);
  ASSERT_TRUE(eventually([&] {
    return admin_->ask({{"verb", "status"}})->content["health"] == "ok";
  })) << "found out without anybody's seed";
  EXPECT_TRUE(seed().answer);
}

}  // namespace
}  // namespace cairn
