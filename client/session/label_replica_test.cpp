// SPDX-License-Identifier: Apache-2.0
#include "client/session/label_replica.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr Epoch kEpoch{7};

wire::LabelMessage label(uint64_t id, const std::string& text, Epoch epoch = kEpoch) {
  wire::LabelMessage message;
  message.epoch = epoch;
  message.label.id = {id};
  message.label.text = text;
  return message;
}

std::vector<std::string> texts(LabelReplica* replica, Epoch epoch = kEpoch) {
  std::vector<std::string> found;
  if (const LabelListPtr& list = replica->list(epoch)) {
    for (const Label& l : *list) found.push_back(l.text);
  }
  return found;
}

using Texts = std::vector<std::string>;

TEST(LabelReplica, HoldsTheNewestOfEachAndNoneThatWasRemoved) {
  LabelReplica replica;
  EXPECT_EQ(replica.list(kEpoch), nullptr);
  replica.receive(label(2, "vice"));
  replica.receive(label(1, "drill"));
  EXPECT_EQ(texts(&replica), (Texts{"drill", "vice"}));
  replica.receive(label(1, "drill press"));
  EXPECT_EQ(texts(&replica), (Texts{"drill press", "vice"}));
  replica.removed(LabelId{2});
  replica.removed(LabelId{9});
  EXPECT_EQ(texts(&replica), (Texts{"drill press"}));
  replica.removed(LabelId{1});
  EXPECT_EQ(replica.list(kEpoch), nullptr);
}

TEST(LabelReplica, TheListIsTheSameUntilSomethingChanges) {
  LabelReplica replica;
  replica.receive(label(1, "drill"));
  const LabelListPtr before = replica.list(kEpoch);
  replica.update({}, true);
  EXPECT_EQ(replica.list(kEpoch), before);
  replica.receive(label(2, "vice"));
  EXPECT_NE(replica.list(kEpoch), before);
  EXPECT_EQ(before->size(), 1U) << "a list handed out never changes";
}

TEST(LabelReplica, EpochsNeverMix) {
  LabelReplica replica;
  replica.receive(label(1, "old", Epoch{6}));
  replica.receive(label(2, "new"));
  EXPECT_EQ(texts(&replica), Texts{"new"});
  EXPECT_EQ(texts(&replica, Epoch{6}), Texts{"old"});
  replica.receive(label(1, "old"));
  EXPECT_EQ(texts(&replica), (Texts{"old", "new"}));
}

TEST(LabelReplica, WhatAServerThatIsBackDoesNotNameAgainIsGone) {
  LabelReplica replica;
  MonotonicTime now{};
  replica.receive(label(1, "kept"));
  replica.receive(label(2, "removed meanwhile"));
  replica.update(now, true);
  for (const uint64_t id : {1, 2}) replica.orphaned(LabelId{id}, now);
  for (int i = 0; i < 100; ++i) replica.update(now += milliseconds(100), false);
  EXPECT_EQ(texts(&replica).size(), 2U) << "labels stay while the server is away";
  replica.update(now += milliseconds(100), true);
  replica.receive(label(1, "kept"));
  replica.update(now + kOrphanGrace - milliseconds(1), true);
  EXPECT_EQ(texts(&replica).size(), 2U) << "it may not have spoken yet";
  replica.update(now + kOrphanGrace, true);
  EXPECT_EQ(texts(&replica), Texts{"kept"});
}

TEST(LabelReplica, AnOrphanOfAMomentAgoHasItsGraceToo) {
  LabelReplica replica;
  MonotonicTime now{};
  replica.receive(label(1, "drill"));
  replica.update(now, true);
  now += 10 * kOrphanGrace;
  replica.orphaned(LabelId{1}, now);
  replica.update(now + kOrphanGrace / 2, true);
  EXPECT_EQ(texts(&replica), Texts{"drill"});
  replica.update(now + kOrphanGrace, true);
  EXPECT_TRUE(texts(&replica).empty());
}

TEST(LabelReplica, WhoJoinsAnewHasWhatIsNamedAgain) {
  LabelReplica replica;
  MonotonicTime now{};
  replica.receive(label(1, "kept"));
  replica.receive(label(2, "removed meanwhile"));
  replica.update(now, true);
  replica.orphan_all(now += 10 * kOrphanGrace);
  replica.update(now += milliseconds(100), true);
  replica.receive(label(1, "kept"));
  EXPECT_EQ(texts(&replica).size(), 2U);
  replica.update(now + kOrphanGrace, true);
  EXPECT_EQ(texts(&replica), Texts{"kept"});
}

}  // namespace
}  // namespace cairn
