// SPDX-License-Identifier: Apache-2.0
// A server with a store: what it was comes back, and clients go on as if nothing had happened.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>

#include "server/store/store.h"
#include "tests/integration/server_process.h"
#include "tests/integration/store_folder.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::eventually;
using ::testing::HasSubstr;
using testing::ServerProcess;

constexpr int kLastStep = 16;  ///< of Scene::pose(): beyond, too little of the first views is seen

class KeptMaps : public ::testing::Test {
 protected:
  KeptMaps() : server_(std::make_unique<ServerProcess>(0, arguments())) {
    SessionOptions options;
    options.domain = server_->domain();
    options.name = "anna";
    session_ = testing::open_session(options, scene_.camera());
  }

  [[nodiscard]] std::vector<std::string> arguments() const { return {"--store", folder_.path().string()}; }
  void restart() { server_ = std::make_unique<ServerProcess>(server_->domain(), arguments()); }

  void seed() {
    ASSERT_TRUE(session_->wait_for_server(60s));
    session_->send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(session_->wait_for_map(60s)) << session_->status().text;
    const auto reply = session_->take_seed_reply();
    ASSERT_TRUE(reply && reply->answer) << (reply ? reply->reason : "no reply");
  }
  void send_offer(int step) {
    testing::Frame frame = testing::make_offer(scene_, *session_->snapshot(), step);
    session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
  }
  [[nodiscard]] std::optional<OfferReply> next_reply() {
    std::vector<OfferReply> replies;
    (void)eventually([&] { return !(replies = session_->take_offer_replies()).empty(); });
    return replies.size() == 1 ? std::optional(replies.front()) : std::nullopt;
  }
  void offer(int step) {
    send_offer(step);
    const auto reply = next_reply();
    ASSERT_TRUE(reply);
    EXPECT_TRUE(reply->accepted) << reply->reason;
  }

  const testing::Scene scene_{11};
  const testing::StoreFolder folder_{"kept-maps"};
  std::unique_ptr<ServerProcess> server_;
  std::unique_ptr<Session> session_;
};

TEST_F(KeptMaps, AKilledServersSuccessorIsTakenForTheSame) {
  seed();
  offer(4);
  const MapSnapshotPtr before = session_->snapshot();
  EXPECT_EQ(server_->end(SIGKILL), -SIGKILL);
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kGone; }));
  send_offer(6);
  EXPECT_EQ(session_->status().spooled, 1U);

  restart();
  const auto reply = next_reply();
  ASSERT_TRUE(reply);
  EXPECT_TRUE(reply->accepted) << "tracked in the epoch before: " << reply->reason;
  EXPECT_EQ(session_->status().link, ServerLink::kConnected);
  EXPECT_TRUE(session_->status().map_known);
  ASSERT_TRUE(eventually([&] { return session_->snapshot()->epoch > before->epoch; }));
  ASSERT_TRUE(eventually([&] { return session_->snapshot()->keyframe_count() == 4U; }));
  EXPECT_EQ(session_->snapshot()->map, before->map);
  EXPECT_EQ(session_->snapshot()->name, before->name);
  offer(8);
}

TEST_F(KeptMaps, AnOrderlyEndKeepsAllThatWasDone) {
  seed();
  for (const int step : {4, 6, 8}) offer(step);
  EXPECT_EQ(server_->end(SIGTERM), 0);
  const auto store = Store::open(folder_.path(), null_logger());
  ASSERT_TRUE(store) << store.error().message;
  ASSERT_EQ((*store)->maps().size(), 1U);
  const auto map = (*store)->load((*store)->maps()[0]);
  ASSERT_TRUE(map);
  EXPECT_TRUE(map->damage.empty());
  EXPECT_EQ(map->record.keyframes.size(), 5U);
  EXPECT_EQ(map->decisions.size(), 4U) << "the seed and three offers";
}

TEST_F(KeptMaps, AnotherCameraLetsARestoredMapGrow) {
  seed();
  offer(4);
  EXPECT_EQ(server_->end(SIGTERM), 0);
  const MapSnapshotPtr before = session_->snapshot();
  session_.reset();
  restart();
  SessionOptions options;
  options.domain = server_->domain();
  options.name = "bert";
  CameraParameters other = scene_.camera()->parameters();
  other.values[0] *= 1.0001;  // another camera that sees the same: the scene renders one only
  session_ = testing::open_session(options, *make_camera(other));
  ASSERT_TRUE(session_->wait_for_server(60s));
  session_->use_map(before->map);
  ASSERT_TRUE(session_->wait_for_map(60s));
  EXPECT_EQ(session_->snapshot()->keyframe_count(), 3U);
  offer(6);
}

TEST_F(KeptMaps, AFullDiskIsSaidAndOverWhenThereIsRoom) {
  seed();
  const rlimit tight{200 << 10, RLIM_INFINITY};
  ASSERT_EQ(prlimit(server_->pid(), RLIMIT_FSIZE, &tight, nullptr), 0);
  send_offer(4);
  const auto refused = next_reply();
  ASSERT_TRUE(refused);
  EXPECT_FALSE(refused->accepted);
  EXPECT_THAT(refused->reason, HasSubstr(folder_.path().string()));
  EXPECT_EQ(session_->status().link, ServerLink::kConnected) << "it goes on";

  const rlimit wide{RLIM_INFINITY, RLIM_INFINITY};
  ASSERT_EQ(prlimit(server_->pid(), RLIMIT_FSIZE, &wide, nullptr), 0);
  int step = 4;
  ASSERT_TRUE(eventually([&] {
    step = step < kLastStep ? step + 2 : 4;
    send_offer(step);
    const auto reply = next_reply();
    return reply && reply->accepted;
  }));
  const size_t keyframes = session_->snapshot()->keyframe_count();
  EXPECT_EQ(server_->end(SIGKILL), -SIGKILL);
  const auto store = Store::open(folder_.path(), null_logger());
  ASSERT_TRUE(store);
  const auto map = (*store)->load((*store)->maps()[0]);
  ASSERT_TRUE(map);
  EXPECT_TRUE(map->damage.empty());
  EXPECT_GE(map->record.keyframes.size(), keyframes);
}

}  // namespace
}  // namespace cairn
