// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/place_index.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "server/relocalization/match.h"
#include "server/relocalization/places_fixture.h"
#include "server/relocalization/votes.h"

namespace cairn {
namespace {

using testing::all_maps;
using testing::describe_image;
using testing::ExactMap;
using testing::Scene;

class PlaceIndexTest : public testing::PlacesTest {};

TEST_F(PlaceIndexTest, TheListsOfAMapSayWhatItsKeyframesSay) {
  for (const IndexedMapPtr& map : index_.maps()) {
    size_t listed = 0;
    for (size_t word = 0; word < kVocabularyWords; ++word) {
      for (const uint32_t k : map->lists.of(static_cast<WordId>(word))) {
        const auto& words = map->keyframes[k]->words;
        ASSERT_TRUE(std::binary_search(words.begin(), words.end(), word));
        ++listed;
      }
    }
    size_t shown = 0;
    for (const IndexedKeyframePtr& k : map->keyframes) shown += k->words.size();
    EXPECT_EQ(listed, shown);
  }
  PlaceIndex changing = index_;
  changing.put(map().index());  // the same again
  changing.remove(places_->other_map.snapshot()->map);
  const InvertedLists& lists = changing.maps().front()->lists;
  for (size_t word = 0; word < kVocabularyWords; ++word)
    ASSERT_EQ(changing.shown(static_cast<WordId>(word)), lists.of(static_cast<WordId>(word)).size());
}

TEST_F(PlaceIndexTest, WordsVoteForTheMapThatIsSeen) {
  for (const int step : {1, 2, 5, 7, 9}) {
    for (const auto& [scene, map] :
         {std::pair(&places_->scene, &places_->map), std::pair(&places_->other_scene, &places_->other_map)}) {
      const PlaceView view = describe_image(scene->render(Scene::pose(step), 4)->view());
      const auto votes = vote(index_, all_maps(index_), view, probed_cells(view), 1, VoteOptions());
      ASSERT_EQ(votes.size(), 1U);
      EXPECT_EQ(votes.front().map->snapshot->map, map->snapshot()->map) << step;
    }
  }
}

/// Cells leave out nine tenths of the comparisons, and with them some of the nearest; how many is the price.
TEST_F(PlaceIndexTest, MatchingInCellsFindsMostOfWhatAFullSearchFinds) {
  const PlaceView view = describe_image(scene().render(Scene::pose(5), 3)->view());
  const auto cells = probed_cells(view);
  const IndexedMap& indexed = *index_.find(map().snapshot()->map);
  const IndexedKeyframe& keyframe = *indexed.keyframes[1];
  const auto matches = testing::match_all(view, indexed, 1);
  size_t near = 0;
  size_t found = 0;
  for (size_t i = 0; i < view.corners.size(); ++i) {
    const auto nearest = find_nearest(view.corners[i].descriptor, keyframe.as_taken.descriptors);
    if (nearest.distance > 40) continue;
    const PointId id =
        keyframe.measured[keyframe.as_taken.points[static_cast<size_t>(nearest.index)].measured];
    ++near;
    found += std::any_of(matches.begin(), matches.end(), [&](const PlaceMatch& m) { return m.point == id; })
                 ? 1
                 : 0;
  }
  ASSERT_GT(near, 50U);
  EXPECT_GT(static_cast<double>(found), 0.7 * static_cast<double>(near));
}

TEST_F(PlaceIndexTest, TheMemoryOfAnIndexIsAboutWhatIsSaid) {
  const IndexedMapPtr indexed = map().index();
  const auto bytes = [](const auto& vector) { return vector.capacity() * sizeof(vector[0]); };
  size_t held = sizeof(IndexedMap) + bytes(indexed->lists.begin) + bytes(indexed->lists.keyframes);
  size_t measurements = 0;
  for (size_t k = 0; k < indexed->keyframes.size(); ++k) {
    const IndexedKeyframe& keyframe = *indexed->keyframes[k];
    measurements += keyframe.measured.size();
    held += sizeof(keyframe) + sizeof(CompactImage) + bytes(keyframe.tiny.values()) + bytes(keyframe.words) +
            bytes(keyframe.measured) + bytes(keyframe.sightings) + bytes(indexed->positions[k]);
    for (const DescribedPoints* exposed : {&keyframe.as_taken, &*keyframe.overexposed})
      held += bytes(exposed->points) + bytes(exposed->descriptors) + bytes(exposed->of_measured);
  }
  const size_t said = bytes_indexed(indexed->keyframes.size(), measurements);
  EXPECT_GT(static_cast<double>(said), 0.85 * static_cast<double>(held));
  EXPECT_LT(static_cast<double>(said), 1.15 * static_cast<double>(held));
}

TEST_F(PlaceIndexTest, TheIndexSharesWhatHasNotChanged) {
  const IndexedMapPtr first = map().index();
  std::vector<KeyframeView> views = map().views();
  views[1].measurements.pop_back();
  const IndexedMapPtr second = index_map(first.get(), map().snapshot(), views, GravityOptions());
  ASSERT_EQ(second->keyframes.size(), 3U);
  EXPECT_EQ(first->keyframes[0], second->keyframes[0]);
  EXPECT_NE(first->keyframes[1], second->keyframes[1]);
  EXPECT_EQ(first->keyframes[2], second->keyframes[2]);

  std::vector<KeyframeView> moved = map().views();
  moved[2].measurements[7].pixel.x() += 3;
  EXPECT_NE(index_map(first.get(), map().snapshot(), moved, GravityOptions())->keyframes[2],
            first->keyframes[2]);

  views[1].pyramid = nullptr;
  views[1].measurements.pop_back();
  const IndexedMapPtr third = index_map(second.get(), map().snapshot(), views, GravityOptions());
  ASSERT_EQ(third->keyframes.size(), 3U);
  EXPECT_EQ(second->keyframes[1], third->keyframes[1]) << "there is no image to describe it anew";
  EXPECT_EQ(index_map(nullptr, map().snapshot(), views, GravityOptions())->keyframes.size(), 2U);

  views[0].id = KeyframeId{9};  // the snapshot does not have it
  EXPECT_EQ(index_map(second.get(), map().snapshot(), views, GravityOptions())->keyframes.size(), 2U);

  PlaceIndex index = index_;
  index.remove(map().snapshot()->map);
  EXPECT_EQ(index.find(map().snapshot()->map), nullptr);
  EXPECT_EQ(index_.keyframe_count(), 6U) << "copies are values";
  EXPECT_EQ(index.keyframe_count(), 3U);
}

}  // namespace
}  // namespace cairn
