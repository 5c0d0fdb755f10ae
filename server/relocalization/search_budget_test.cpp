// SPDX-License-Identifier: Apache-2.0
// How many keyframes are looked at closer, and which: where many look like the place, none of them by chance
// takes all looks.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "server/relocalization/exact_map.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

using testing::describe_image;
using testing::ExactMap;
using testing::Scene;

constexpr uint8_t kDecoyMap = 1;
constexpr uint8_t kRightMap = 2;
constexpr double kAlways = 0;
constexpr double kNever = 1e6;

/// A map whose keyframes look like the scene, with each point at another's place: corners move as their
/// neighbours do, so a pose is looked for, and none is found.
IndexedMapPtr make_decoys(const Scene& scene) {
  const ExactMap map(scene, kDecoyMap, {2, 2, 2, 2, 2, 2, 2, 4, 4, 4, 4, 4, 4, 4});
  auto decoys = std::make_shared<IndexedMap>(*map.index());
  for (auto& positions : decoys->positions) std::ranges::reverse(positions);
  return decoys;
}

class SearchBudgetTest : public ::testing::Test {
 protected:
  SearchBudgetTest() {
    static const Scene scene(11);
    static const PlaceView view = describe_image(scene.render(Scene::pose(3), 103)->view());
    static const IndexedMapPtr decoys = make_decoys(scene);
    static const IndexedMapPtr right = ExactMap(scene, kRightMap, {3}).index();
    static const IndexedMapPtr right_from_afar = ExactMap(scene, kRightMap, {5}).index();
    scene_ = &scene;
    view_ = &view;
    decoys_ = decoys;
    right_ = right;
    right_from_afar_ = right_from_afar;
    options_.confirm.clear_agreeing = 10'000;  // nothing ends the search
  }

  [[nodiscard]] RelocalizationAnswer ask(const std::vector<IndexedMapPtr>& maps,
                                         const SearchScope& scope = {}) const {
    PlaceIndex index;
    for (const IndexedMapPtr& map : maps) index.put(map);
    return relocalize(index, *scene_->camera(), *view_, options_, scope);
  }
  /// Those at which a closer look was taken, and with which no pose was found or one that was refused.
  [[nodiscard]] static ptrdiff_t decoys_tried(const RelocalizationAnswer& answer) {
    return std::ranges::count(answer.candidates, kDecoyMap,
                              [](const PlaceCandidate& c) { return c.map.bytes[0]; });
  }

  const Scene* scene_ = nullptr;
  const PlaceView* view_ = nullptr;
  IndexedMapPtr decoys_;
  IndexedMapPtr right_;            ///< mapped from where the query was taken
  IndexedMapPtr right_from_afar_;  ///< from farther off than the decoys
  RelocOptions options_;
};

TEST_F(SearchBudgetTest, SixAreLookedAtWhereNothingIsConfirmed) {
  const RelocalizationAnswer answer = ask({decoys_});
  EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown);
  EXPECT_EQ(decoys_tried(answer), 6) << answer.reason;
}

TEST_F(SearchBudgetTest, WhereAPlaceIsBelievedMoreOfItsRivalsAre) {
  options_.least_margin = options_.least_peculiar = kAlways;  // whatever they explain
  const RelocalizationAnswer answer = ask({decoys_, right_});
  ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
  EXPECT_EQ(answer.candidates.front().map.bytes[0], kRightMap);
  EXPECT_EQ(decoys_tried(answer), 6 + 3 - 1);
}

TEST_F(SearchBudgetTest, NotOfOneThatIsRejected) {
  options_.least_margin = kNever;
  const RelocalizationAnswer answer = ask({decoys_, right_});
  EXPECT_EQ(answer.verdict, RelocalizationVerdict::kNotKnown);
  EXPECT_EQ(answer.candidates.front().map.bytes[0], kRightMap);
  EXPECT_EQ(decoys_tried(answer), 6 - 1);
}

TEST_F(SearchBudgetTest, WhatIsLeftOfTheMapsSearchedFirstTakesNoLookFromTheOthers) {
  options_.least_margin = options_.least_peculiar = kAlways;
  const RelocalizationAnswer answer = ask({decoys_, right_from_afar_}, {.first = {decoys_->snapshot->map}});
  ASSERT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << answer.reason;
  EXPECT_EQ(answer.candidates.front().map.bytes[0], kRightMap);
  EXPECT_EQ(ask({decoys_, right_from_afar_}).verdict, RelocalizationVerdict::kNotKnown)
      << "among as many as wait it would not be looked at";
}

}  // namespace
}  // namespace cairn
