// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/map_feed.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <set>

#include "common/wire/partition.h"
#include "common/wire/wire_fixture.h"
#include "server/endpoint/client_link.h"

namespace cairn {
namespace {

constexpr MapId kMap{{7}};
constexpr uint32_t kBlocks = 20;
constexpr size_t kLargestBlock = 50'000;  ///< [bytes]

class MapFeedTest : public wire::WireTest {
 protected:
  MapSnapshotPtr map(uint64_t revision) {
    auto made = std::make_shared<MapSnapshot>();
    made->map = kMap;
    made->epoch = {1};
    made->revision = {revision};
    for (uint32_t index = 0; index < kBlocks; ++index) {
      auto patches = random_.make<wire::PointPatches>().block;
      auto positions = random_.make<wire::PointPositions>().block;
      patches.index = positions.index = index;
      patches.version = positions.version = revision;
      auto block = std::make_shared<PointBlock>();
      block->patches = std::make_shared<const PatchBlock>(std::move(patches));
      block->positions = std::make_shared<const PositionBlock>(std::move(positions));
      made->point_blocks.push_back(std::move(block));
    }
    auto keyframes = random_.make<wire::KeyframePoses>().block;
    keyframes.index = 0;
    keyframes.version = revision;
    made->keyframe_blocks.push_back(std::make_shared<const KeyframeBlock>(std::move(keyframes)));
    return made;
  }
  MapFeed feed(const wire::Participant& server, const std::string& client) {
    return MapFeed::create(server, client, kMap, blocks_, null_logger()).value();
  }
  /// All of the newest revision, so many bytes at a time; how many in each turn.
  static std::vector<size_t> send(MapFeed* feed, size_t bytes) {
    const MonotonicTime now{std::chrono::hours(1)};
    std::vector<size_t> turns;
    for (auto due = feed->deadline(); due && *due <= now; due = feed->deadline())
      turns.push_back(feed->work(now, bytes));
    return turns;
  }

  std::shared_ptr<SerializedBlocks> blocks_ = std::make_shared<SerializedBlocks>();
};

/// Of one client, in the order of their indices.
template <typename Message>
std::vector<Message> received(const wire::Participant& participant, const std::string& client, size_t count) {
  auto from = wire::reader<Message>(participant, wire::map_partition(client, kMap));
  std::vector<Message> messages;
  for (auto& sample : wire::collect(&from, count)) {
    EXPECT_TRUE(sample.message);
    if (sample.message) messages.push_back(*std::move(sample.message));
  }
  std::ranges::sort(messages, {}, [](const Message& message) { return message.block.index; });
  return messages;
}

template <typename Message, typename Expected>
void expect_blocks(const std::vector<Message>& got,
                   const std::vector<std::shared_ptr<const Expected>>& sent) {
  ASSERT_EQ(got.size(), sent.size());
  for (size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ(got[i].map, kMap);
    EXPECT_TRUE(wire::testing::same(got[i].block, *sent[i])) << i;
  }
}

TEST_F(MapFeedTest, AllWhoAreSentAMapGetTheSame) {
  const wire::Participant server = this->server();
  const wire::Participant client = this->client();
  const MapSnapshotPtr map = this->map(1);
  std::vector<std::shared_ptr<const PatchBlock>> patches;
  std::vector<std::shared_ptr<const PositionBlock>> positions;
  for (const auto& block : map->point_blocks) {
    patches.push_back(block->patches);
    positions.push_back(block->positions);
  }
  std::vector<MapFeed> feeds;
  for (const std::string name : {"alice", "bob"}) {
    MapFeed& made = feeds.emplace_back(feed(server, name));
    made.update(map);
    send(&made, 100'000);
  }
  for (const std::string name : {"alice", "bob"}) {
    SCOPED_TRACE(name);
    expect_blocks(received<wire::PointPatches>(client, name, kBlocks), patches);
    expect_blocks(received<wire::PointPositions>(client, name, kBlocks), positions);
    expect_blocks(received<wire::KeyframePoses>(client, name, 1), map->keyframe_blocks);
  }
}

TEST_F(MapFeedTest, ARevisionIsWrittenInSlices) {
  const wire::Participant server = this->server();
  MapFeed feed = this->feed(server, "alice");
  MapFeed at_once = this->feed(server, "bob");
  const MapSnapshotPtr map = this->map(1);
  feed.update(map);
  at_once.update(map);
  constexpr size_t kSlice = 50'000;
  const std::vector<size_t> slices = send(&feed, kSlice);
  const std::vector<size_t> whole = send(&at_once, 1'000'000'000);
  ASSERT_EQ(whole.size(), 1U);
  EXPECT_EQ(std::accumulate(slices.begin(), slices.end(), size_t{0}), whole[0]);
  for (const size_t bytes : slices) EXPECT_LT(bytes, kSlice + kLargestBlock);
  EXPECT_GE(slices.size(), whole[0] / (kSlice + kLargestBlock));
}

TEST_F(MapFeedTest, WhoseKeyframeWasAcceptedIsTheAuthorOfThatMapOnly) {
  const MapId other{{8}};
  ClientLink link;
  wire::OfferVerdict verdict;
  const auto add = [&](wire::OfferDecision decision, MapId map) {
    wire::OfferOutcome outcome;
    outcome.decision = decision;
    outcome.map = map;
    verdict.recent.push_back(outcome);
  };
  add(wire::OfferDecision::kKeptAside, kMap);
  add(wire::OfferDecision::kTooClose, other);
  note_author(verdict, &link);
  EXPECT_TRUE(link.authored.empty());
  add(wire::OfferDecision::kAccepted, kMap);
  note_author(verdict, &link);
  EXPECT_EQ(link.authored, std::set{kMap});
}

TEST_F(MapFeedTest, WhoseSeedWasAcceptedIsTheAuthorOfItsMap) {
  ClientLink link;
  wire::SeedVerdict verdict;
  verdict.map = kMap;
  note_author(verdict, &link);
  EXPECT_TRUE(link.authored.empty());
  verdict.accepted = true;
  note_author(verdict, &link);
  EXPECT_EQ(link.authored, std::set{kMap});
}

}  // namespace
}  // namespace cairn
