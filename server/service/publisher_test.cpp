// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "server/service/map_publisher.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr Epoch kEpoch{3};

/// A server's map reduced to versions: which blocks there are and when each last changed.
class FakeMap {
 public:
  FakeMap() { grow(); }

  /// One more point block and keyframe.
  void grow() {
    auto patches = std::make_shared<PatchBlock>();
    patches->index = static_cast<uint32_t>(points_.size());
    patches->version = revision_ + 1;
    patches->points.resize(1);
    patches->points[0].id = {points_.size() * kBlockSlots + 1};
    auto block = std::make_shared<PointBlock>();
    block->patches = patches;
    points_.push_back(block);
    keyframes_.push_back({{keyframes_.size() + 1}, SE3(), 1});
    adjust({patches->index});
  }
  void adjust(const std::vector<uint32_t>& moved) {
    ++revision_;
    for (const uint32_t index : moved) {
      auto positions = std::make_shared<PositionBlock>();
      positions->index = index;
      positions->version = revision_;
      auto block = std::make_shared<PointBlock>();
      block->patches = points_[index]->patches;
      block->positions = positions;
      points_[index] = block;
    }
  }
  [[nodiscard]] MapSnapshotPtr snapshot(Epoch epoch = kEpoch) const {
    auto made = std::make_shared<MapSnapshot>();
    made->map = MapId{{1}};
    made->epoch = epoch;
    made->revision = {revision_};
    made->point_blocks = points_;
    made->keyframe_blocks = {std::make_shared<KeyframeBlock>(KeyframeBlock{0, revision_, 1, keyframes_})};
    return made;
  }

 private:
  uint64_t revision_ = 0;
  std::vector<std::shared_ptr<const PointBlock>> points_;
  std::vector<KeyframePose> keyframes_;
};

class MapPublisherTest : public ::testing::Test {
 protected:
  /// Brings the client up to date with the map as it is.
  void settle() {
    publisher_.update(map_.snapshot());
    ASSERT_TRUE(publisher_.next(now_).has_value());
    publisher_.client_has(kEpoch, map_.snapshot()->revision);
  }

  FakeMap map_;
  MapPublisher publisher_;
  MonotonicTime now_{std::chrono::hours(1)};
};

TEST_F(MapPublisherTest, TheFirstBurstIsEverythingAtOnceAndThenThereIsNothing) {
  map_.grow();
  publisher_.update(map_.snapshot());
  const auto burst = publisher_.next(now_);
  ASSERT_TRUE(burst.has_value());
  EXPECT_EQ(burst->patches.size(), 2U);
  EXPECT_EQ(burst->positions.size(), 2U);
  EXPECT_EQ(burst->keyframes.size(), 1U);
  EXPECT_EQ(burst->commit.points.size(), 2U);
  EXPECT_EQ(burst->commit.keyframe_versions.size(), 1U);
  EXPECT_EQ(burst->commit.revision, map_.snapshot()->revision);
  EXPECT_FALSE(publisher_.deadline().has_value());
  EXPECT_FALSE(publisher_.next(now_ + std::chrono::hours(1)));
}

TEST_F(MapPublisherTest, OnlyBlocksOfANewVersionAreSentButAllAreListed) {
  map_.grow();
  map_.grow();
  settle();
  map_.adjust({1});
  publisher_.update(map_.snapshot());
  const auto burst = publisher_.next(now_ + MapPublisher::kAdjustmentInterval);
  ASSERT_TRUE(burst.has_value());
  EXPECT_TRUE(burst->patches.empty());
  ASSERT_EQ(burst->positions.size(), 1U);
  EXPECT_EQ(burst->positions[0]->index, 1U);
  EXPECT_EQ(burst->commit.points.size(), 3U);
}

TEST_F(MapPublisherTest, AdjustmentsAreCoalescedToFiveASecond) {
  settle();
  int bursts = 0;
  for (int ms = 0; ms < 2000; ms += 10) {
    map_.adjust({0});
    publisher_.update(map_.snapshot());
    if (const auto burst = publisher_.next(now_ + milliseconds(ms))) {
      ++bursts;
      EXPECT_EQ(burst->commit.revision, map_.snapshot()->revision) << "the newest, not a queue of old ones";
      publisher_.client_has(kEpoch, burst->commit.revision);
    }
  }
  EXPECT_GE(bursts, 9);
  EXPECT_LE(bursts, 10);
}

TEST_F(MapPublisherTest, ANewKeyframeGoesAtOnce) {
  settle();
  map_.grow();
  publisher_.update(map_.snapshot());
  EXPECT_TRUE(publisher_.next(now_).has_value());
}

TEST_F(MapPublisherTest, TheNextBurstWaitsForTheClientButNotLongerThanHalfASecond) {
  publisher_.update(map_.snapshot());
  ASSERT_TRUE(publisher_.next(now_).has_value());
  map_.grow();
  publisher_.update(map_.snapshot());
  EXPECT_FALSE(publisher_.next(now_ + milliseconds(499)));
  EXPECT_EQ(publisher_.deadline(), now_ + MapPublisher::kCatchUpLimit);
  EXPECT_TRUE(publisher_.next(now_ + milliseconds(500)).has_value());
}

TEST_F(MapPublisherTest, AfterAFailureEverythingIsSentAgainInAWhile) {
  map_.grow();
  settle();
  map_.adjust({0});
  publisher_.update(map_.snapshot());
  now_ += MapPublisher::kAdjustmentInterval;
  ASSERT_TRUE(publisher_.next(now_).has_value());
  publisher_.failed(now_);
  EXPECT_EQ(publisher_.deadline(), now_ + MapPublisher::kRetryInterval);
  map_.grow();
  publisher_.update(map_.snapshot());
  EXPECT_FALSE(publisher_.next(now_ + MapPublisher::kRetryInterval - milliseconds(1))) << "rate-limited";
  const auto burst = publisher_.next(now_ + MapPublisher::kRetryInterval);
  ASSERT_TRUE(burst.has_value());
  EXPECT_EQ(burst->patches.size(), 3U);
  EXPECT_EQ(burst->positions.size(), 3U);
  EXPECT_EQ(burst->keyframes.size(), 1U);
}

TEST_F(MapPublisherTest, ANewEpochSendsEverythingAgain) {
  map_.grow();
  settle();
  publisher_.update(map_.snapshot(Epoch{kEpoch.value + 1}));
  const auto burst = publisher_.next(now_);
  ASSERT_TRUE(burst.has_value());
  EXPECT_EQ(burst->patches.size(), 2U);
  EXPECT_EQ(burst->positions.size(), 2U);
  EXPECT_EQ(burst->epoch, Epoch{kEpoch.value + 1});
  publisher_.client_has(kEpoch, Revision{1000});  // of the old epoch: does not count
  map_.grow();
  publisher_.update(map_.snapshot(Epoch{kEpoch.value + 1}));
  EXPECT_FALSE(publisher_.next(now_ + milliseconds(499)));
}

}  // namespace
}  // namespace cairn
