// SPDX-License-Identifier: Apache-2.0
// A server with a store: what it was comes back, and clients go on as if nothing had happened.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "common/io/test_directory.h"
#include "common/wire/network_path.h"
#include "server/admin/admin_client.h"
#include "server/store/store.h"
#include "tests/integration/raw_client.h"
#include "tests/integration/server_process.h"
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

  nlohmann::json ask_operator(const nlohmann::json& request) {
    AdminClientOptions connection;
    connection.domain = server_->domain();
    const auto answer = AdminClient::connect(connection).value().ask(request);
    EXPECT_TRUE(answer) << answer.error().message;
    return answer ? answer->content : nlohmann::json();
  }
  /// While no server runs.
  void delete_in_store(MapId map) {
    const auto store = Store::open(folder_.path(), null_logger());
    ASSERT_TRUE(store) << store.error().message;
    EXPECT_TRUE((*store)->remove(map));
  }

  void seed() {
    ASSERT_TRUE(session_->wait_for_server(60s));
    session_->send_seed(testing::make_seed(scene_));
    ASSERT_TRUE(session_->wait_for_map(60s)) << session_->status().text;
    const auto reply = session_->take_seed_reply();
    ASSERT_TRUE(reply && reply->answer) << (reply ? reply->reason : "no reply");
  }
  void send_offer(int step) { send_offer(scene_, step); }
  void send_offer(const testing::Scene& scene, int step) {
    testing::Frame frame = testing::make_offer(scene, *session_->snapshot(), step);
    session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
  }
  [[nodiscard]] std::optional<OfferReply> next_reply() {
    std::vector<OfferReply> replies;
    (void)eventually([&] { return !(replies = session_->take_offer_replies()).empty(); });
    return replies.size() == 1 ? std::optional(replies.front()) : std::nullopt;
  }
  void offer(int step) { offer(scene_, step); }
  void offer(const testing::Scene& scene, int step) {
    send_offer(scene, step);
    const auto reply = next_reply();
    ASSERT_TRUE(reply);
    EXPECT_TRUE(reply->accepted) << reply->reason;
  }

  /// How far a keyframe's camera is from where it was [m].
  [[nodiscard]] static double camera_error(const MapSnapshot& map, KeyframeId keyframe, int step) {
    const SE3& camera_from_map = map.find(keyframe)->camera_from_map;
    return (testing::world_from_map(map) * camera_from_map.center() - testing::Scene::pose(step).center())
        .norm();
  }
  /// How far live points of ids from `first` on are from the nearer plane of the scene [m], ascending.
  [[nodiscard]] static std::vector<double> point_errors(const MapSnapshot& map, PointId first) {
    std::vector<double> errors;
    const Similarity3 to_world = testing::world_from_map(map);
    for (const auto& block : map.point_blocks) {
      for (int slot = 0; slot < block->count; ++slot) {
        const PointId id = block->source(slot).id;
        if (id < first || !map.find(id)) continue;
        const double z = (to_world * block->position(slot)).z();
        errors.push_back(
            std::min(std::abs(z - testing::Scene::kFrontDepth), std::abs(z - testing::Scene::kBackDepth)));
      }
    }
    std::sort(errors.begin(), errors.end());
    return errors;
  }

  static constexpr uint64_t kSeed = 11;
  const testing::Scene scene_{kSeed};
  const TestDirectory folder_;
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

/// The server hears of two processes, of which the first never said good-bye: it has stood still.
TEST_F(KeptMaps, AClientThatJoinsAnewOnItsReplicaIsTheSameToTheServer) {
  const auto moves = std::make_shared<std::atomic<bool>>(false);
  SessionOptions options;
  options.domain = server_->domain();
  options.name = "bert";
  const auto fails = std::make_shared<std::atomic<bool>>(true);
  options.find_path = [moves, fails](const wire::ParticipantOptions& joining) {
    if (fails->exchange(false)) throw std::runtime_error("no memory, as it were");  // nothing comes of that
    auto path = wire::find_path(joining);
    if (path && moves->exchange(false)) path->address = "127.0.0.9";
    return path;
  };
  session_ = testing::open_session(options, scene_.camera());
  seed();
  offer(4);
  const uint64_t sent_before = session_->status().bytes_sent;
  kill(server_->pid(), SIGSTOP);
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kGone; }));
  send_offer(6);
  const MapSnapshotPtr before = session_->snapshot();
  *moves = true;
  ASSERT_TRUE(eventually([&] { return !*fails && !*moves; })) << "it looks how to reach a silent server";
  EXPECT_EQ(session_->snapshot(), before);
  EXPECT_GE(session_->status().bytes_sent, sent_before);

  kill(server_->pid(), SIGCONT);
  const auto reply = next_reply();
  ASSERT_TRUE(reply);
  EXPECT_TRUE(reply->accepted) << reply->reason;
  ASSERT_TRUE(eventually([&] { return session_->snapshot()->keyframe_count() == 4U; }));
  EXPECT_EQ(session_->snapshot()->epoch, before->epoch);
  offer(8);
}

/// It has no place in the domain any more by then, and nothing but that gives a reason to join.
TEST_F(KeptMaps, AClientWhoseJoiningAnewFailsHalfWayTriesAgain) {
  struct Network {
    std::atomic<bool> moves{false};
    std::atomic<int> failures{0};  ///< that are still to come
  };
  const auto network = std::make_shared<Network>();
  SessionOptions options;
  options.domain = server_->domain();
  options.name = "bert";
  options.find_path = [network](const wire::ParticipantOptions& joining) {
    auto path = wire::find_path(joining);
    if (path && network->moves.exchange(false)) path->address = "127.0.0.9";
    return path;
  };
  options.join = [network](const wire::ParticipantOptions& joining) {
    if (network->failures > 0 && network->failures-- > 0) throw std::runtime_error("no memory, as it were");
    return wire::Participant::create(joining);
  };
  session_ = testing::open_session(options, scene_.camera());
  seed();
  kill(server_->pid(), SIGSTOP);
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kGone; }));
  network->failures = 2;
  network->moves = true;
  ASSERT_TRUE(eventually([&] { return network->failures == 0; })) << "the second try is without a move";
  kill(server_->pid(), SIGCONT);
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kConnected; }));
  offer(4);
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
  CameraParameters wider;  // larger images, more of the scene in them, a lens that bends the other way
  wider.width = 640;
  wider.height = 480;
  wider.values = {430, 433, 322, 236, 0.06, -0.02, 0.001, -0.0005};
  const testing::Scene as_seen_by_bert(kSeed, *make_camera(wider));
  SessionOptions options;
  options.domain = server_->domain();
  options.name = "bert";
  session_ = testing::open_session(options, as_seen_by_bert.camera());
  ASSERT_TRUE(session_->wait_for_server(60s));
  session_->use_map(before->map);
  ASSERT_TRUE(session_->wait_for_map(60s));
  EXPECT_EQ(session_->snapshot()->keyframe_count(), 3U);
  constexpr int kSteps[] = {7, 10, 13};
  for (const int step : kSteps) offer(as_seen_by_bert, step);
  ASSERT_TRUE(session_->wait_until_settled(60s));
  ASSERT_TRUE(eventually([&] { return session_->snapshot()->keyframe_count() == 6U; }));

  const MapSnapshotPtr after = session_->snapshot();
  KeyframeId keyframe{4};
  for (const int step : kSteps) {
    EXPECT_LT(camera_error(*after, keyframe, step), 0.001) << "step " << step;
    ++keyframe.value;
  }
  const std::vector<double> errors = point_errors(*after, {before->point_blocks.size() * kBlockSlots + 1});
  ASSERT_GT(errors.size(), 100U) << "it sees what the first camera has not";
  EXPECT_LT(errors[errors.size() / 2], 0.003);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.01);
}

TEST_F(KeptMaps, WhatWasOfferedToAMapThatIsDeletedMeanwhileIsAnswered) {
  seed();
  offer(4);
  const MapId map = session_->snapshot()->map;
  EXPECT_EQ(server_->end(SIGKILL), -SIGKILL);
  ASSERT_TRUE(eventually([&] { return session_->status().link == ServerLink::kGone; }));
  send_offer(6);
  delete_in_store(map);
  restart();
  const auto reply = next_reply();
  ASSERT_TRUE(reply);
  EXPECT_FALSE(reply->accepted);
  EXPECT_THAT(reply->reason, HasSubstr("does not know the map"));
  EXPECT_EQ(session_->status().spooled, 0U);
}

/// Nobody has heard of the first map, and so it is asked for again: it is not made a second time.
TEST_F(KeptMaps, ASeedWhoseMapWasDeletedBeforeAKillMakesNoOther) {
  testing::RawClient bert(server_->domain(), "bert", scene_.camera());
  const wire::MapSeed asked = testing::seed_of(bert, 1, scene_);
  const auto verdict = [&]() -> std::optional<wire::SeedVerdict> {
    bert.forget_what_was_heard();
    (void)eventually([&] {
      bert.announce(scene_.camera()->parameters());
      bert.spin();
      (void)bert.seeds.write(asked);
      return bert.seed_verdict.has_value();
    });
    return bert.seed_verdict;
  };
  const auto first = verdict();
  ASSERT_TRUE(first && first->accepted) << (first ? first->reason : "no verdict");
  (void)ask_operator({{"verb", "delete"}, {"map", to_hex(first->map.bytes)}});
  EXPECT_EQ(server_->end(SIGKILL), -SIGKILL);
  restart();
  const auto second = verdict();
  ASSERT_TRUE(second);
  EXPECT_TRUE(second->accepted) << second->reason;
  EXPECT_EQ(second->map, first->map);
  const auto maps = ask_operator({{"verb", "maps"}});
  EXPECT_EQ(maps["maps"].size(), 0U);
  EXPECT_EQ(maps["deleted"].size(), 1U);
}

TEST_F(KeptMaps, AFullDiskIsSaidAndOverWhenThereIsRoom) {
  seed();
  const rlimit tight{40 << 10, RLIM_INFINITY};  // less than a keyframe takes
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
