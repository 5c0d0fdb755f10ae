// SPDX-License-Identifier: Apache-2.0
// The replica under continuous adjustments and packet loss: soon up to date, and never half a revision.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <mutex>
#include <thread>

#include "tests/integration/adjusted_map.h"
#include "tests/integration/test_domain.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

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

/// What was published when, and what of it a replica showed.
class Ledger {
 public:
  void published(const MapSnapshot& map) {
    const std::scoped_lock lock(mutex_);
    entries_[map.revision] = {hash_of(map), Steady::now()};
  }
  void shown(const MapSnapshot& map) {
    const std::scoped_lock lock(mutex_);
    const auto entry = entries_.find(map.revision);
    ASSERT_NE(entry, entries_.end()) << "revision " << map.revision.value << " was never published";
    EXPECT_EQ(hash_of(map), entry->second.hash) << "revision " << map.revision.value << " is half another";
  }
  /// For how long the replica has lacked the first revision that it has not.
  [[nodiscard]] Steady::duration lag(Revision shown) const {
    const std::scoped_lock lock(mutex_);
    const auto missing = entries_.upper_bound(shown);
    return missing == entries_.end() ? Steady::duration::zero() : Steady::now() - missing->second.time;
  }

 private:
  struct Entry {
    uint64_t hash = 0;
    Steady::time_point time;
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

  testing::AdjustedMap map(kMap, kSeed, kBlocks);
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
  Steady::duration worst{};
  const auto end = Steady::now() + 10s;  // length of the experiment, not a limit
  for (auto due = Steady::now(); Steady::now() < end;) {
    if (Steady::now() >= due) {
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
    return ledger.lag(session->snapshot()->revision) == Steady::duration::zero();
  })) << "once the adjustments end, the replica is complete";
}

}  // namespace
}  // namespace cairn
