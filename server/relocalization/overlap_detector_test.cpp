// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/overlap_detector.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr float kDepth = 1;        ///< of all keyframes [unit of their map]
constexpr double kStep = 0.2;      ///< from each to the next [the same]
constexpr size_t kKeyframes = 12;  ///< of each map

/// Keyframe `id` of a map whose camera went along a line; `start`: where it began.
SE3 camera_at(uint64_t id, double start) {
  return {so3_exp({0, 0.02 * static_cast<double>(id), 0}), {-start - kStep * static_cast<double>(id), 0, 0}};
}

class OverlapDetectorTest : public ::testing::Test {
 protected:
  static MapId map_called(uint8_t id) { return MapId{{id}}; }
  /// A map of `count` keyframes is searched. `map_from_world`: of its own frame.
  void search(uint8_t id, const Similarity3& map_from_world, double start = 0, size_t count = kKeyframes) {
    auto block = std::make_shared<KeyframeBlock>();
    auto map = std::make_shared<IndexedMap>();
    for (uint64_t k = 1; k <= count; ++k) {
      block->keyframes.push_back({KeyframeId{k}, map_from_world.transform_camera(camera_at(k, start)),
                                  kDepth * static_cast<float>(map_from_world.scale())});
      block->live |= uint64_t{1} << (k - 1);
      auto keyframe = std::make_shared<IndexedKeyframe>();
      keyframe->id = KeyframeId{k};
      map->keyframes.push_back(std::move(keyframe));
    }
    auto snapshot = std::make_shared<MapSnapshot>();
    snapshot->map = map_called(id);
    snapshot->keyframe_blocks = {block};
    map->snapshot = snapshot;
    map->images.resize(count);
    map->positions.resize(count);
    map->lists = invert(map->keyframes);
    index_.put(map);
    detector_.note_searched(*map);
  }
  /// The image of a keyframe is found near one of another map, from where it was taken: as both maps know.
  [[nodiscard]] PlaceCandidate found(uint8_t in, uint64_t near,
                                     const SE3& camera_from_keyframe = SE3()) const {
    PlaceCandidate candidate;
    candidate.map = map_called(in);
    candidate.keyframe = KeyframeId{near};
    candidate.camera_from_keyframe = camera_from_keyframe;
    candidate.confirmed = true;
    return candidate;
  }
  std::vector<Overlap> ask(uint8_t map, uint64_t keyframe, const std::vector<PlaceCandidate>& found) {
    return detector_.note_answer(map_called(map), KeyframeId{keyframe}, detector_.now(), found, index_);
  }

  const Similarity3 one_{0.7, so3_exp({0.1, 2, 0.3}), {1, 2, 3}};
  const Similarity3 other_{2.5, so3_exp({1, -0.2, 0}), {-4, 0, 9}};
  PlaceIndex index_;
  OverlapDetector detector_{OverlapOptions()};
};

TEST_F(OverlapDetectorTest, ThreeKeyframesThatAgreeAreAnOverlap) {
  search(1, one_);
  search(2, other_);
  EXPECT_TRUE(ask(2, 3, {found(1, 3)}).empty());
  EXPECT_TRUE(ask(2, 5, {found(1, 5)}).empty());
  auto overlaps = ask(2, 8, {found(1, 8)});
  ASSERT_EQ(overlaps.size(), 1U);
  EXPECT_EQ(overlaps[0].maps, (MapPair{map_called(1), map_called(2)}));
  EXPECT_EQ(overlaps[0].of_one, 0U);
  EXPECT_EQ(overlaps[0].of_other, 3U);
  overlaps = ask(1, 10, {found(2, 10)});
  ASSERT_EQ(overlaps.size(), 1U) << "and the other way round";
  EXPECT_EQ(overlaps[0].of_one, 1U);
  EXPECT_EQ(overlaps[0].of_other, 3U);
}

TEST_F(OverlapDetectorTest, BothDirectionsSpeakForOne) {
  search(1, one_);
  search(2, other_);
  EXPECT_TRUE(ask(2, 3, {found(1, 3)}).empty());
  EXPECT_TRUE(ask(1, 5, {found(2, 5)}).empty());
  EXPECT_EQ(ask(2, 8, {found(1, 8)}).size(), 1U);
}

TEST_F(OverlapDetectorTest, KeyframesFoundHereAndThereAreNone) {
  search(1, one_);
  search(2, other_);
  // By no order along the other's path.
  for (const auto& [keyframe, near] : {std::pair(2, 9), {4, 3}, {6, 11}, {8, 1}, {10, 7}, {12, 2}})
    EXPECT_TRUE(ask(2, static_cast<uint64_t>(keyframe), {found(1, static_cast<uint64_t>(near))}).empty());
}

/// What is alike is found from some places and not from others between them.
TEST_F(OverlapDetectorTest, WhatIsOftenNotRecognizedFromWhereItWasMappedIsAnother) {
  search(1, one_);
  search(2, other_);
  for (const uint64_t unknown : {1, 2, 6, 9}) EXPECT_TRUE(ask(2, unknown, {}).empty());
  for (const uint64_t k : {3, 4, 5}) EXPECT_TRUE(ask(2, k, {found(1, k)}).empty()) << k;
  EXPECT_EQ(ask(2, 7, {found(1, 7)}).size(), 1U) << "four, and four missed";
}

TEST_F(OverlapDetectorTest, WhatNobodyCouldHaveRecognizedIsNotMissed) {
  search(1, one_);
  search(2, other_, 0, 6);
  // Before there was the other map; far from it; and where a third map was found.
  search(3, one_, 50);
  for (const uint64_t k : {1, 2, 3, 4}) EXPECT_TRUE(ask(3, k, {}).empty());
  search(4, other_, 50);
  for (const uint64_t k : {5, 6}) EXPECT_TRUE(ask(3, k, {found(1, k)}).empty());
  for (const uint64_t k : {8, 9}) EXPECT_TRUE(ask(3, k, {found(4, k)}).empty());
  EXPECT_EQ(ask(3, 10, {found(4, 10)}).size(), 1U);

  for (const uint64_t far : {9, 10, 11, 12}) EXPECT_TRUE(ask(1, far, {}).empty());
  for (const uint64_t k : {2, 4}) EXPECT_TRUE(ask(1, k, {found(2, k)}).empty());
  EXPECT_EQ(ask(1, 6, {found(2, 6)}).size(), 1U);
}

TEST_F(OverlapDetectorTest, AnAdjustmentTakesWhatIsKnownAlong) {
  search(1, one_);
  search(2, other_);
  for (const uint64_t k : {3, 5}) EXPECT_TRUE(ask(2, k, {found(1, k)}).empty());
  search(1, other_);  // the same place by another scale
  EXPECT_EQ(ask(2, 8, {found(1, 8)}).size(), 1U);
}

TEST_F(OverlapDetectorTest, WhatIsGoneSaysNothing) {
  search(1, one_);
  search(2, other_);
  for (const uint64_t k : {3, 5}) EXPECT_TRUE(ask(2, k, {found(1, k)}).empty());
  detector_.remove(map_called(1));
  index_.remove(map_called(1));
  EXPECT_TRUE(ask(2, 8, {found(1, 8)}).empty()) << "asked before it went";
  search(1, one_);
  EXPECT_TRUE(ask(2, 9, {found(1, 9)}).empty()) << "begun anew";

  search(2, other_, 0, 4);  // the rest is culled
  EXPECT_TRUE(ask(2, 9, {found(1, 9)}).empty());
  EXPECT_TRUE(ask(2, 3, {found(1, 3)}).empty());
  EXPECT_TRUE(ask(2, 4, {found(1, 4)}).empty()) << "two, with those that are left";
  detector_.remove(map_called(2));
  EXPECT_TRUE(ask(2, 2, {found(1, 2)}).empty());
}

}  // namespace
}  // namespace cairn
