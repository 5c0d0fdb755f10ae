// SPDX-License-Identifier: Apache-2.0
// kill -9 at any moment, under load: all that was said to be accepted is there, once, and the files are
// sound.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "common/io/test_directory.h"
#include "server/admin/admin_client.h"
#include "server/store/store.h"
#include "tests/integration/server_process.h"
#include "tests/integration/test_domain.h"
#include "tests/integration/two_views.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using testing::ServerProcess;

constexpr int kSeed = 20261121;
constexpr int kCyclesPerStore = 10;  ///< maps pile up: a new folder now and then keeps a cycle short
constexpr int kLastStep = 16;        ///< of Scene::pose(): beyond, too little of the first views is seen
constexpr unsigned kShortestLifeMs = 50;
constexpr unsigned kLongestLifeMs = 750;
constexpr unsigned kIdleLifeMs = 5000;  ///< more for maps to become idle: kept after 2 s, unused for 1
constexpr int kCyclesPerEviction = 5;   ///< in between the idle ones are paged in, and killed meanwhile

int number_from(const char* variable, int otherwise) {
  const char* wanted = std::getenv(variable);
  return wanted != nullptr ? std::atoi(wanted) : otherwise;
}

int cycles() {
  return number_from("CAIRN_KILL_CYCLES", 40);
}

int seed() {
  return number_from("CAIRN_KILL_SEED", kSeed);
}

/// A tracker that maps as fast as it can: seeds a map, offers frames until the scene is used up, seeds the
/// next. Remembers what the server has said.
class Builder {
 public:
  Builder(const testing::Scene& scene, int domain, std::string name) : scene_(scene), name_(std::move(name)) {
    SessionOptions options;
    options.domain = domain;
    options.name = name_;
    session_ = testing::open_session(options, scene.camera());
    thread_ = std::thread([this] { run(); });
  }
  ~Builder() {
    stopping_ = true;
    thread_.join();
  }
  Builder(const Builder&) = delete;
  Builder& operator=(const Builder&) = delete;

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] std::set<uint64_t> accepted() const {
    const std::scoped_lock lock(mutex_);
    return accepted_;
  }
  [[nodiscard]] std::set<MapId> made() const {
    const std::scoped_lock lock(mutex_);
    return made_;
  }

 private:
  void run() {
    bool seeding = false;
    int step = 4;
    while (!stopping_) {
      take_replies(&seeding);
      const MapSnapshotPtr map = session_->snapshot();
      if (map == nullptr && !seeding) {
        session_->send_seed(testing::make_seed(scene_));
        seeding = true;
        step = 4;
      } else if (map != nullptr && step > kLastStep) {
        if (session_->status().spooled == 0) session_->leave_map();
      } else if (map != nullptr && session_->status().spooled < 3) {
        testing::Frame frame = testing::make_offer(scene_, *map, step);
        session_->send_offer(std::move(frame.proposal), std::move(frame.image), Timestamp{step});
        step += 2;
      }
      std::this_thread::sleep_for(2ms);
    }
    bool ignored = false;
    take_replies(&ignored);
  }
  void take_replies(bool* seeding) {
    const std::scoped_lock lock(mutex_);
    if (const auto reply = session_->take_seed_reply()) {
      *seeding = false;
      if (reply->answer) made_.insert(reply->answer->map);
    }
    for (const OfferReply& reply : session_->take_offer_replies()) {
      if (reply.accepted) accepted_.insert(reply.seq);
    }
  }

  const testing::Scene& scene_;
  const std::string name_;
  std::unique_ptr<Session> session_;
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;
  std::set<uint64_t> accepted_;
  std::set<MapId> made_;
  std::thread thread_;
};

/// What a client was told before the kill, against what the files say after it.
void expect_kept(Store& store, const std::string& client, const std::set<uint64_t>& accepted,
                 const std::set<MapId>& made) {
  std::set<uint64_t> kept;
  std::set<MapId> maps;
  for (const MapId id : store.maps()) {
    const auto map = store.load(id);
    ASSERT_TRUE(map) << map.error().message;
    EXPECT_THAT(map->damage, ::testing::IsEmpty());
    maps.insert(id);
    std::set<KeyframeId> keyframes;
    for (const KeyframeRecord& k : map->record.keyframes) keyframes.insert(k.id);
    EXPECT_EQ(keyframes.size(), map->record.keyframe_count);
    size_t offers = 0;
    for (const DecisionRecord& d : map->decisions) {
      if (d.kind != CommandKind::kOffer || d.decision != 0) continue;
      ++offers;
      EXPECT_TRUE(keyframes.contains(d.keyframe)) << "accepted, not there";
      if (d.client != client) continue;
      EXPECT_TRUE(kept.insert(d.seq).second) << "offer " << d.seq << " was taken twice";
    }
    EXPECT_EQ(map->record.keyframe_count, 2 + offers) << "a keyframe without its decision";
  }
  for (const uint64_t seq : accepted) EXPECT_TRUE(kept.contains(seq)) << "offer " << seq << " is lost";
  for (const MapId map : made) EXPECT_TRUE(maps.contains(map)) << "a map is lost";
}

/// Of maps that were being made when it was killed, nothing stays.
void expect_no_litter(const std::filesystem::path& maps) {
  for (const auto& entry : std::filesystem::directory_iterator(maps))
    EXPECT_THAT(entry.path().extension().string(), ::testing::StartsWith(".cairnmap")) << entry.path();
}

/// Maps of the server that are idle.
int idle_maps(int domain) {
  AdminClientOptions connection;
  connection.domain = domain;
  auto admin = AdminClient::connect(connection);
  if (!admin) throw std::runtime_error(admin.error().message);
  const auto status = admin->ask({{"verb", "status"}});
  if (!status) throw std::runtime_error(status.error().message);
  return status->content.value("maps_at_rest", 0);
}

/// In every other folder the images of maps are evicted as soon as they can be.
TEST(KillMinus9, LosesNothingThatWasAccepted) {
  SCOPED_TRACE(::testing::Message() << "repeat with CAIRN_KILL_SEED=" << seed()
                                    << " CAIRN_KILL_CYCLES=" << cycles());
  const testing::Scene scene(11);
  std::mt19937 random(static_cast<unsigned>(seed()));
  size_t accepted_in_all = 0;
  size_t maps_in_all = 0;
  int became_idle = 0;
  int folders = 0;
  unsigned longest_life_ms = kLongestLifeMs;
  for (int cycle = 0; cycle < cycles(); ++folders) {
    const bool evicts = folders % 2 == 1;
    const TestDirectory folder;
    const std::vector<std::string> arguments{"--store", folder.path().string(), "--idle-after",
                                             evicts ? "1" : "60"};
    auto server = std::make_unique<ServerProcess>(0, arguments);
    std::array<Builder, 2> builders{Builder(scene, server->domain(), "anna"),
                                    Builder(scene, server->domain(), "bert")};
    for (int i = 0; i < kCyclesPerStore && cycle < cycles(); ++i, ++cycle) {
      SCOPED_TRACE(::testing::Message() << "cycle " << cycle);
      const unsigned life_ms = kShortestLifeMs + random() % (longest_life_ms - kShortestLifeMs);
      const bool is_long = evicts && i % kCyclesPerEviction == 0;
      std::this_thread::sleep_for(std::chrono::milliseconds(life_ms + (is_long ? kIdleLifeMs : 0)));
      // Those that come back with a server are idle from the start: the first has none.
      if (evicts && i == 0) became_idle += idle_maps(server->domain());
      ASSERT_EQ(server->end(SIGKILL), -SIGKILL);
      {
        // What is heard from now on was said before the end.
        const auto store = Store::open(folder.path(), null_logger());
        ASSERT_TRUE(store) << store.error().message;
        for (const Builder& b : builders) expect_kept(**store, b.name(), b.accepted(), b.made());
        expect_no_litter(folder.path() / "maps");
        if (::testing::Test::HasFailure()) return;
      }
      server = std::make_unique<ServerProcess>(server->domain(), arguments);
    }
    size_t accepted = 0;
    for (const Builder& b : builders) {
      accepted += b.accepted().size();
      maps_in_all += b.made().size();
    }
    accepted_in_all += accepted;
    std::printf("%d of %d kills: %zu keyframes accepted in %zu maps\n", cycle, cycles(), accepted_in_all,
                maps_in_all);
    std::fflush(stdout);
    if (accepted < kCyclesPerStore)
      longest_life_ms *= 2;  // a slow machine: the work done counts, not the time
  }
  EXPECT_GT(accepted_in_all, static_cast<size_t>(cycles()) / 2) << "too little load to tell anything";
  std::printf("%d maps became idle in the first lives of %d folders\n", became_idle, folders / 2);
  EXPECT_TRUE(became_idle > 0 || folders < 2) << "none has been killed that became idle by itself";
}

}  // namespace
}  // namespace cairn
