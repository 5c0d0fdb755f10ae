// SPDX-License-Identifier: Apache-2.0
#include "client/session/replica.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <variant>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr unsigned kSeed = 7041;
const MapId kMap{{1, 2, 3}};
constexpr Epoch kEpoch{5};

using Message = std::variant<wire::PointPatches, wire::PointPositions, wire::KeyframePoses, wire::MapCommit>;

/// A map whose every number tells the revision it was written in: mixtures show.
class Author {
 public:
  explicit Author(Epoch epoch = kEpoch) : epoch_(epoch) {}

  /// All messages of the next revision that moves the blocks in `moved`; blocks and keyframe block appear
  /// with the first one.
  std::vector<Message> revise(const std::vector<uint32_t>& moved, uint32_t block_count) {
    ++revision_;
    std::vector<Message> messages;
    const auto stamp = static_cast<double>(revision_);
    versions_.resize(block_count, {0, 0, 0});
    for (uint32_t index = 0; index < block_count; ++index) {
      wire::BlockVersion& version = versions_[index];
      const bool is_new = version.patches == 0;
      if (!is_new && std::find(moved.begin(), moved.end(), index) == moved.end()) continue;
      if (is_new) {
        version = {index, revision_, 0};
        wire::PointPatches patches{kMap, epoch_, {index, revision_, {}}};
        patches.block.points.resize(2);
        for (uint64_t slot = 0; slot < 2; ++slot) {
          patches.block.points[slot].id = {1 + index * kBlockSlots + slot};
          patches.block.points[slot].keyframe = {1};
        }
        messages.emplace_back(std::move(patches));
      }
      version.positions = revision_;
      wire::PointPositions positions{kMap, epoch_, {index, revision_, 3, {}, {}}};
      positions.block.positions.assign(2, Eigen::Vector3f(0, 0, static_cast<float>(stamp)));
      positions.block.visibility.resize(2);
      messages.emplace_back(std::move(positions));
    }
    KeyframePose pose{{1}, SE3(Eigen::Quaterniond::Identity(), {stamp, 0, 0}), 1};
    messages.emplace_back(wire::KeyframePoses{kMap, epoch_, {0, revision_, 1, {pose}}});
    messages.emplace_back(wire::MapCommit{kMap,
                                          "desk",
                                          epoch_,
                                          {revision_},
                                          true,
                                          versions_,
                                          {revision_},
                                          {{{}, 0, static_cast<uint32_t>(revision_)}}});
    return messages;
  }

 private:
  Epoch epoch_;
  uint64_t revision_ = 0;
  std::vector<wire::BlockVersion> versions_;
};

void deliver(Replica* replica, const std::vector<Message>& messages) {
  for (const Message& message : messages) std::visit([&](const auto& m) { replica->receive(m); }, message);
}

/// What the snapshot claims to be made of against what its blocks say they are.
void expect_exact(const MapSnapshot& snapshot) {
  const auto revision = static_cast<double>(snapshot.revision.value);
  ASSERT_EQ(snapshot.keyframe_blocks.size(), 1U);
  EXPECT_EQ(snapshot.keyframe_blocks[0]->keyframes[0].camera_from_map.translation().x(), revision);
  ASSERT_EQ(snapshot.cameras.size(), 1U);
  EXPECT_EQ(snapshot.cameras[0].version, snapshot.revision.value);
  for (const auto& block : snapshot.point_blocks) EXPECT_LE(block->z[0], revision);
}

TEST(Replica, SwapsOnlyWhenEveryListedVersionIsThereInAnyOrder) {
  std::mt19937 random(kSeed);
  SCOPED_TRACE(::testing::Message() << "seed " << kSeed);
  for (int trial = 0; trial < 50; ++trial) {
    Author author;
    std::vector<Message> messages = author.revise({}, 5);
    std::shuffle(messages.begin(), messages.end(), random);
    Replica replica(kMap);
    MonotonicTime now{};
    for (size_t i = 0; i < messages.size(); ++i) {
      EXPECT_EQ(replica.snapshot(), nullptr);
      deliver(&replica, {messages[i]});
      EXPECT_EQ(replica.update(now), i + 1 == messages.size());
      now += milliseconds(1000);
    }
    ASSERT_NE(replica.snapshot(), nullptr);
    EXPECT_EQ(replica.snapshot()->point_blocks.size(), 5U);
    EXPECT_EQ(replica.snapshot()->name, "desk");
    EXPECT_TRUE(replica.snapshot()->metric);
    expect_exact(*replica.snapshot());
  }
}

TEST(Replica, RevisionsNeverGoBack) {
  Author author;
  Replica replica(kMap);
  const auto first = author.revise({}, 2);
  const auto second = author.revise({0}, 2);
  deliver(&replica, first);
  deliver(&replica, second);
  ASSERT_TRUE(replica.update({}));
  EXPECT_EQ(replica.snapshot()->revision, Revision{2});
  deliver(&replica, first);  // a history sent again
  EXPECT_FALSE(replica.update(MonotonicTime{} + milliseconds(5000)));
  EXPECT_EQ(replica.snapshot()->revision, Revision{2});
  expect_exact(*replica.snapshot());
}

TEST(Replica, OvertakenCommitWaitsThenTakesNewerBlocks) {
  Author author;
  Replica replica(kMap);
  MonotonicTime now{};
  deliver(&replica, author.revise({}, 3));
  ASSERT_TRUE(replica.update(now));
  auto second = author.revise({0, 1, 2}, 3);
  const auto third = author.revise({0}, 3);
  deliver(&replica, second);
  deliver(&replica, {third.front()});  // block 0 is newer than commit 2 lists; commit 3 is on its way
  EXPECT_FALSE(replica.update(now));
  ASSERT_TRUE(replica.deadline().has_value());
  EXPECT_EQ(*replica.deadline(), now + kOvertakenLimit);
  now += kOvertakenLimit - milliseconds(1);
  EXPECT_FALSE(replica.update(now));
  now += milliseconds(1);
  EXPECT_TRUE(replica.update(now));
  EXPECT_EQ(replica.snapshot()->revision, Revision{2});
  EXPECT_EQ(replica.snapshot()->point_blocks[0]->z[0], 3);
  deliver(&replica, third);
  EXPECT_TRUE(replica.update(now));
  EXPECT_EQ(replica.snapshot()->revision, Revision{3});
  expect_exact(*replica.snapshot());
}

TEST(Replica, AnOlderBlockIsNeverTakenHoweverLongItWaits) {
  Author author;
  Replica replica(kMap);
  deliver(&replica, author.revise({}, 2));
  ASSERT_TRUE(replica.update({}));
  auto second = author.revise({0, 1}, 2);
  second.erase(second.begin());  // block 0 is lost
  deliver(&replica, second);
  deliver(&replica, {author.revise({1}, 2).front()});  // and block 1 overtakes
  EXPECT_FALSE(replica.update({}));
  EXPECT_FALSE(replica.update(MonotonicTime{} + std::chrono::hours(1)));
  EXPECT_FALSE(replica.deadline().has_value()) << "waiting alone would not help: no busy loop";
  EXPECT_EQ(replica.snapshot()->revision, Revision{1});
}

TEST(Replica, BeingOvertakenAgainAndAgainDoesNotPutOffTheSwap) {
  Author author;
  Replica replica(kMap);
  MonotonicTime now{};
  deliver(&replica, author.revise({}, 2));
  ASSERT_TRUE(replica.update(now));
  MonotonicTime last_swap = now;
  auto messages = author.revise({0, 1}, 2);
  for (int i = 0; i < 100; ++i) {
    const auto next = author.revise({0, 1}, 2);
    deliver(&replica, messages);
    deliver(&replica, {next.front()});  // each commit is overtaken before update() sees it
    now += milliseconds(100);
    if (replica.update(now)) last_swap = now;
    EXPECT_LE(now - last_swap, kOvertakenLimit + milliseconds(200));
    messages = next;
  }
}

TEST(Replica, EpochsNeverMix) {
  Author old_author(kEpoch);
  Author new_author(Epoch{kEpoch.value + 1});
  Replica replica(kMap);
  deliver(&replica, old_author.revise({}, 3));
  ASSERT_TRUE(replica.update({}));
  const auto old_second = old_author.revise({0, 1, 2}, 3);
  auto fresh = new_author.revise({}, 3);
  const Message last = fresh[1];
  fresh.erase(fresh.begin() + 1);
  deliver(&replica, fresh);
  deliver(&replica, old_second);  // late, with higher versions: of no use any more
  EXPECT_FALSE(replica.update(MonotonicTime{} + std::chrono::hours(1)));
  EXPECT_EQ(replica.snapshot()->epoch, kEpoch);
  deliver(&replica, {last});
  EXPECT_TRUE(replica.update({}));
  EXPECT_EQ(replica.snapshot()->epoch, Epoch{kEpoch.value + 1});
  EXPECT_EQ(replica.snapshot()->revision, Revision{1}) << "a new epoch counts its own revisions";
  expect_exact(*replica.snapshot());
}

TEST(Replica, OtherMapsArePassedOver) {
  Author author;
  Replica replica(MapId{{9}});
  deliver(&replica, author.revise({}, 2));
  EXPECT_FALSE(replica.update({}));
}

TEST(Replica, SharesWhatDidNotChangeAndDependsOnTheRevisionOnly) {
  const auto message = [](uint32_t index, uint64_t version, float z) {
    wire::PointPositions positions{kMap, kEpoch, {index, version, 1, {Eigen::Vector3f(0, 0, z)}, {{}}}};
    return positions;
  };
  const auto patches = [](uint32_t index, uint64_t keyframe) {
    wire::PointPatches made{kMap, kEpoch, {index, 1, {}}};
    made.block.points.resize(1);
    made.block.points[0].id = {index + 1};
    made.block.points[0].keyframe = {keyframe};
    made.block.points[0].ray_right = Eigen::Vector3f(0.01F, 0, 1).normalized();
    made.block.points[0].ray_down = Eigen::Vector3f(0, 0.01F, 1).normalized();
    return made;
  };
  const auto poses = [](uint64_t version, double second_x) {
    wire::KeyframePoses made{kMap, kEpoch, {0, version, 3, {}}};
    made.block.keyframes = {{{1}, SE3(), 1}, {{2}, SE3(Eigen::Quaterniond::Identity(), {second_x, 0, 0}), 1}};
    return made;
  };
  const auto commit = [](uint64_t revision, uint64_t block0, uint64_t keyframes) {
    return wire::MapCommit{kMap,        "", kEpoch, {revision}, false, {{0, 1, block0}, {1, 1, 1}, {2, 1, 1}},
                           {keyframes}, {}};
  };
  Replica all(kMap);
  deliver(&all, {patches(0, 1), patches(1, 1), patches(2, 2), message(0, 1, 2), message(1, 1, 2),
                 message(2, 1, 2), poses(1, 0), commit(1, 1, 1)});
  ASSERT_TRUE(all.update({}));
  const MapSnapshotPtr before = all.snapshot();
  // Block 0 moves, and keyframe 2, the source of block 2.
  deliver(&all, {message(0, 2, 3), poses(2, 0.5), commit(2, 2, 2)});
  ASSERT_TRUE(all.update({}));
  const MapSnapshotPtr after = all.snapshot();
  EXPECT_NE(after->point_blocks[0], before->point_blocks[0]);
  EXPECT_EQ(after->point_blocks[1], before->point_blocks[1]);
  EXPECT_NE(after->point_blocks[2], before->point_blocks[2]);

  Replica late(kMap);  // sees revision 2 only
  deliver(&late, {patches(0, 1), patches(1, 1), patches(2, 2), message(0, 2, 3), message(1, 1, 2),
                  message(2, 1, 2), poses(2, 0.5), commit(2, 2, 2)});
  ASSERT_TRUE(late.update({}));
  for (size_t b = 0; b < 3; ++b) {
    EXPECT_EQ(late.snapshot()->point_blocks[b]->right, after->point_blocks[b]->right);
    EXPECT_EQ(late.snapshot()->point_blocks[b]->down, after->point_blocks[b]->down);
    EXPECT_NE(after->point_blocks[b]->right[0], Eigen::Vector3f::Zero());
  }
}

}  // namespace
}  // namespace cairn
