// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/feed_turns.h"

#include <gtest/gtest.h>

#include <deque>

namespace cairn {
namespace {

struct FakeFeed {
  size_t left = 0;
  size_t work(MonotonicTime, size_t bytes) {
    const size_t written = std::min(bytes, left);
    left -= written;
    return std::max<size_t>(written, 1);
  }
};

constexpr size_t kShare = FeedTurns<FakeFeed>::kBytesPerShare;

class FeedTurnsTest : public ::testing::Test {
 protected:
  struct Client {
    std::string name;
    bool is_author;
    FakeFeed feed;
  };
  FakeFeed& add(bool is_author, size_t bytes) {
    const std::string number = std::to_string(1000 + clients_.size());  // in the order of their names
    clients_.push_back({"client-" + number, is_author, FakeFeed{bytes}});
    return clients_.back().feed;
  }
  /// How many bytes were written.
  size_t take_turn() {
    const size_t before = all_left();
    std::vector<FeedTurns<FakeFeed>::Waiting> waiting;
    for (Client& client : clients_) {
      if (client.feed.left > 0) waiting.push_back({client.name, MapId{{1}}, client.is_author, &client.feed});
    }
    turns_.take_turn(waiting, MonotonicTime());
    return before - all_left();
  }
  [[nodiscard]] size_t all_left() const {
    size_t sum = 0;
    for (const Client& client : clients_) sum += client.feed.left;
    return sum;
  }

  std::deque<Client> clients_;
  FeedTurns<FakeFeed> turns_;
};

TEST_F(FeedTurnsTest, ATurnWritesNoMoreForManyClientsThanForOne) {
  for (const size_t readers : {1, 8, 64}) {
    clients_.clear();
    for (size_t i = 0; i < readers; ++i) add(false, 100 * kShare);
    EXPECT_EQ(take_turn(), kShare) << readers;
  }
}

TEST_F(FeedTurnsTest, AnAuthorWaitsForNoReaders) {
  for (int i = 0; i < 64; ++i) add(false, 1000 * kShare);
  const FakeFeed& author = add(true, 3 * kShare);
  for (int turn = 0; turn < 3; ++turn) take_turn();
  EXPECT_EQ(author.left, 0U);
}

TEST_F(FeedTurnsTest, AReaderIsNotForgottenForAnAuthorThatAlwaysWaits) {
  add(true, 1000 * kShare);
  const FakeFeed& reader = add(false, 3 * kShare);
  for (int turn = 0; turn < 3; ++turn) take_turn();
  EXPECT_EQ(reader.left, 0U);
}

TEST_F(FeedTurnsTest, ThoseThatWaitAreServedInTurns) {
  constexpr size_t kReaders = 5;
  for (size_t i = 0; i < kReaders; ++i) add(false, 100 * kShare);
  for (size_t turn = 0; turn < kReaders; ++turn) take_turn();
  for (const Client& client : clients_) EXPECT_EQ(client.feed.left, 99 * kShare) << client.name;
}

TEST_F(FeedTurnsTest, WhatOneLeavesOfAShareIsForTheNext) {
  for (int i = 0; i < 24; ++i) add(false, kShare / 8);
  EXPECT_EQ(take_turn(), kShare);
  EXPECT_EQ(take_turn(), kShare);
  EXPECT_EQ(take_turn(), kShare);
  EXPECT_EQ(all_left(), 0U);
}

TEST_F(FeedTurnsTest, OneThatHasGoneIsNotMissed) {
  for (int i = 0; i < 3; ++i) add(false, 100 * kShare);
  take_turn();
  clients_.pop_front();
  EXPECT_EQ(take_turn(), kShare);
  EXPECT_EQ(clients_.front().feed.left, 99 * kShare);
}

}  // namespace
}  // namespace cairn
