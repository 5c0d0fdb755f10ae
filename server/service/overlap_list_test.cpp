// SPDX-License-Identifier: Apache-2.0
#include "server/service/overlap_list.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

const MapId kDesk{{1}};
const MapId kRoom{{2}};
const MapId kAttic{{3}};

Overlap overlap(const MapId& a, const MapId& b, size_t of_one, size_t of_other) {
  return {pair_of(a, b), of_one, of_other};
}

TEST(OverlapList, IsNewOnceAndKeepsTheMostThatWasSeen) {
  OverlapList list;
  EXPECT_FALSE(list.take_changed());
  EXPECT_TRUE(list.note(overlap(kDesk, kRoom, 1, 3), Timestamp{7}));
  EXPECT_TRUE(list.take_changed());
  EXPECT_FALSE(list.take_changed());
  EXPECT_FALSE(list.note(overlap(kDesk, kRoom, 1, 2), Timestamp{8}));
  EXPECT_FALSE(list.take_changed()) << "nothing was learnt";
  EXPECT_FALSE(list.note(overlap(kRoom, kDesk, 4, 0), Timestamp{9}));
  EXPECT_TRUE(list.take_changed());
  ASSERT_EQ(list.all().size(), 1U);
  EXPECT_EQ(list.all()[0], (OverlapRecord{kDesk, kRoom, 4, 3, Timestamp{7}}));
}

TEST(OverlapList, EachMapSeesItFromItsSideAndTheClosestNeighbourFirst) {
  OverlapList list;
  EXPECT_TRUE(list.note(overlap(kDesk, kRoom, 1, 3), {}));
  EXPECT_TRUE(list.note(overlap(kRoom, kAttic, 9, 0), {}));
  const auto of_room = list.of(kRoom);
  ASSERT_EQ(of_room.size(), 2U);
  EXPECT_EQ(of_room[0].map, kAttic);
  EXPECT_EQ(of_room[0].keyframes, 9U);
  EXPECT_EQ(of_room[0].its_keyframes, 0U);
  EXPECT_EQ(of_room[1].map, kDesk);
  EXPECT_EQ(of_room[1].keyframes, 3U);
  EXPECT_EQ(of_room[1].its_keyframes, 1U);
  ASSERT_EQ(list.of(kDesk).size(), 1U);
  EXPECT_EQ(list.of(kDesk)[0].keyframes, 1U);
}

TEST(OverlapList, WhatIsForgottenIsGoneAndWhatIsRestoredIsNotNew) {
  OverlapList list;
  list.restore({{kDesk, kRoom, 4, 3, Timestamp{7}}, {kRoom, kAttic, 3, 0, Timestamp{8}}});
  EXPECT_FALSE(list.take_changed());
  EXPECT_FALSE(list.note(overlap(kDesk, kRoom, 3, 0), Timestamp{9}));
  list.forget(MapId{{9}});
  EXPECT_FALSE(list.take_changed());
  list.forget(kDesk);
  EXPECT_TRUE(list.take_changed());
  EXPECT_TRUE(list.of(kDesk).empty());
  EXPECT_EQ(list.of(kRoom).size(), 1U);
  EXPECT_TRUE(list.note(overlap(kDesk, kRoom, 3, 0), Timestamp{9}));
}

}  // namespace
}  // namespace cairn
