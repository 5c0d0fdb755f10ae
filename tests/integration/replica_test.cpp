// SPDX-License-Identifier: Apache-2.0
// The replica under continuous adjustments and packet loss: soon up to date, and never half a revision.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <mutex>
#include <random>
#include <thread>

#include "tests/integration/test_domain.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr unsigned kSeed = 555;
constexpr uint32_t kBlocks = 40;
constexpr int kLossPerMille = 50;
const MapId kMap{{4, 2}};

/// FNV-1a over what a tracker uses.
class Hash {
 public:
  void add(const void* data, size_t size) {
    for (size_t i = 0; i < size; ++i)
      value_ = (value_ ^ static_cast<const uint8_t*>(data)[i]) * 1099511628211U;
  }
  [[nodiscard]] uint64_t value() const { return value_; }

 private:
  uint64_t value_ = 14695981039346656037U;
};

uint64_t hash_of(const MapSnapshot& map) {
  Hash hash;
  for (const auto& block : map.keyframe_blocks) {
    for (const KeyframePose& keyframe : block->keyframes) {
      hash.add(keyframe.camera_from_map.translation().data(), 3 * sizeof(double));
      hash.add(keyframe.camera_from_map.rotation().coeffs().data(), 4 * sizeof(double));
    }
  }
  for (const auto& block : map.point_blocks) {
    const uint64_t live = block->live;
    hash.add(&live, sizeof(live));
    for (const auto* numbers : {&block->x, &block->y, &block->z}) hash.add(numbers->data(), sizeof(*numbers));
    for (const auto& vector : block->right) hash.add(vector.data(), 3 * sizeof(float));
  }
  return hash.value();
}

/// A map under continuous adjustment: each revision moves some blocks and the keyframes; now and then it
/// grows.
class AdjustedMap {
 public:
  AdjustedMap() {
    for (uint32_t index = 0; index < kBlocks; ++index) grow();
  }

  MapSnapshotPtr next() {
    ++revision_;
    if (revision_ % 20 == 0) grow();
    auto keyframes = std::make_shared<KeyframeBlock>();
    keyframes->version = revision_;
    keyframes->live = 1;
    keyframes->keyframes = {{{1}, SE3(Eigen::Quaterniond::Identity(), {offset(), offset(), offset()}), 2}};
    auto snapshot = std::make_shared<MapSnapshot>();
    snapshot->map = kMap;
    snapshot->name = "adjusted";
    snapshot->epoch = {1};
    snapshot->revision = {revision_};
    snapshot->keyframe_blocks = {keyframes};
    for (size_t b = 0; b < patches_.size(); ++b) {
      if (random_() % 3 != 0) move(b);
      snapshot->point_blocks.push_back(
          make_point_block(patches_[b], positions_[b], snapshot->keyframe_blocks));
    }
    return snapshot;
  }

 private:
  double offset() { return std::uniform_real_distribution<double>(-0.1, 0.1)(random_); }

  void grow() {
    auto block = std::make_shared<PatchBlock>();
    block->index = static_cast<uint32_t>(patches_.size());
    block->version = revision_ + 1;
    block->points.resize(kBlockSlots);
    for (size_t slot = 0; slot < kBlockSlots; ++slot) {
      PointSource& point = block->points[slot];
      point.id = {1 + patches_.size() * kBlockSlots + slot};
      point.keyframe = {1};
      point.corner = {20, 20};
      point.ray_right = Eigen::Vector3f(0.002F, 0, 1).normalized();
      point.ray_down = Eigen::Vector3f(0, 0.002F, 1).normalized();
      for (uint8_t& pixel : point.pixels) pixel = static_cast<uint8_t>(random_());
    }
    patches_.push_back(block);
    positions_.emplace_back();
    move(patches_.size() - 1);
  }

  void move(size_t b) {
    auto block = std::make_shared<PositionBlock>();
    block->index = static_cast<uint32_t>(b);
    block->version = revision_ + 1;
    block->live = ~uint64_t{0};
    block->visibility.resize(kBlockSlots);
    for (int slot = 0; slot < kBlockSlots; ++slot) {
      block->positions.push_back(
          (Eigen::Vector3d(0, 0, 2) + Eigen::Vector3d(offset(), offset(), offset())).cast<float>());
    }
    positions_[b] = block;
  }

  std::mt19937 random_{kSeed};
  uint64_t revision_ = 0;
  std::vector<std::shared_ptr<const PatchBlock>> patches_;
  std::vector<std::shared_ptr<const PositionBlock>> positions_;
};

/// What was published when, and what of it a replica showed.
class Ledger {
 public:
  void published(const MapSnapshot& map) {
    const std::scoped_lock lock(mutex_);
    entries_[map.revision] = {hash_of(map), Clock::now()};
  }
  void shown(const MapSnapshot& map) {
    const std::scoped_lock lock(mutex_);
    const auto entry = entries_.find(map.revision);
    ASSERT_NE(entry, entries_.end()) << "revision " << map.revision.value << " was never published";
    EXPECT_EQ(hash_of(map), entry->second.hash) << "revision " << map.revision.value << " is half another";
  }
  /// For how long the replica has lacked the first revision that it has not.
  [[nodiscard]] Clock::duration lag(Revision shown) const {
    const std::scoped_lock lock(mutex_);
    const auto missing = entries_.upper_bound(shown);
    return missing == entries_.end() ? Clock::duration::zero() : Clock::now() - missing->second.time;
  }

 private:
  struct Entry {
    uint64_t hash = 0;
    Clock::time_point time;
  };
  mutable std::mutex mutex_;
  std::map<Revision, Entry> entries_;
};

TEST(Replica, UnderContinuousAdjustmentsAndLossIsNeverFarBehindAndNeverHalfARevision) {
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  ServiceOptions service_options;
  service_options.loss_per_mille = kLossPerMille;
  const auto service = testing::start_service(&service_options);
  SessionOptions session_options;
  session_options.domain = service_options.domain;
  session_options.name = "anna";
  session_options.xmit_loss_permille = kLossPerMille;
  const auto session = testing::open_session(session_options, testing::test_camera());
  session->use_map(kMap);

  AdjustedMap map;
  Ledger ledger;
  const auto publish = [&] {
    const MapSnapshotPtr snapshot = map.next();
    ledger.published(*snapshot);
    service->publish(snapshot);
  };
  publish();
  ASSERT_TRUE(testing::eventually([&] { return session->snapshot() != nullptr; }));

  MapSnapshotPtr last;
  int swaps = 0;
  Clock::duration worst{};
  const auto end = Clock::now() + 10s;  // length of the experiment, not a limit
  for (auto due = Clock::now(); Clock::now() < end;) {
    if (Clock::now() >= due) {
      due += 33ms;
      publish();
    }
    const MapSnapshotPtr now = session->snapshot();
    worst = std::max(worst, ledger.lag(now->revision));
    if (now != last) {
      if (last) {
        EXPECT_GT(now->revision, last->revision) << "revisions never go back";
      }
      ledger.shown(*now);
      last = now;
      ++swaps;
    }
    std::this_thread::sleep_for(1ms);
  }
  const double worst_seconds = std::chrono::duration<double>(worst).count();
  std::printf("%d swaps, %.0f ms behind at worst\n", swaps, 1000 * worst_seconds);
  EXPECT_LE(worst_seconds, 1.0);
  EXPECT_GE(swaps, 15);
  EXPECT_TRUE(testing::eventually([&] {
    return ledger.lag(session->snapshot()->revision) == Clock::duration::zero();
  })) << "once the adjustments end, the replica is complete";
}

}  // namespace
}  // namespace cairn
