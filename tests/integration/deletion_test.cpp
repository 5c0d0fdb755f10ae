// SPDX-License-Identifier: Apache-2.0
// Maps that go while people use them: every offer is answered, and what has gone is nowhere found again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <map>

#include "client/tracking/frame_images.h"
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
    session_->send_question(
        std::make_shared<const PlaceView>(describe_place(images.pyramid, images.all_corners())),
        Timestamp{++asked_});
    std::optional<PlaceAnswer> answer;
    EXPECT_TRUE(eventually([&] { return (answer = session_->take_place_answer()).has_value(); }));
    std::vector<MapId> maps;
    if (answer) {
      for (const PlaceCandidate& candidate : answer->candidates) maps.push_back(candidate.map);
    }
    return maps;
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
