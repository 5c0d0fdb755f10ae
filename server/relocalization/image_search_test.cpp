// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/image_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "server/relocalization/test_images.h"

namespace cairn {
namespace {

using testing::image_map;
using testing::LeafPlace;
using testing::map_id;

constexpr size_t kKeyframes = 20;  // of each map

/// Somewhere in a place; half of the reach is where its keyframes are.
TinyImage random_view(const LeafPlace& place, std::mt19937_64* random) {
  constexpr int kReach = LeafPlace::kMargin / 2;
  const auto step = [&] { return static_cast<int>((*random)() % (2 * kReach + 1)) - kReach; };
  const int dx = step();
  const int dy = step();
  return place.view(dx, dy, 0.5F + 0.5F * static_cast<float>((*random)() % 100) / 100);
}

std::vector<TinyImage> make_images(uint32_t place_number, size_t count) {
  std::mt19937_64 random(place_number);
  const LeafPlace place(place_number);
  std::vector<TinyImage> images;
  for (size_t i = 0; i < count; ++i) images.push_back(random_view(place, &random));
  return images;
}

IndexedMapPtr make_map(uint32_t number, size_t keyframes = kKeyframes) {
  return image_map(map_id(number), make_images(number, keyframes));
}

PlaceIndex make_index(uint32_t maps) {
  PlaceIndex index;
  for (uint32_t i = 1; i <= maps; ++i) index.put(make_map(i));
  return index;
}

QueryImage make_query(uint32_t place, uint64_t seed) {
  std::mt19937_64 random(seed);
  return QueryImage(random_view(LeafPlace(place), &random));
}

bool is_same(const Ranked& a, const Ranked& b) {
  return a.map == b.map && a.keyframe == b.keyframe;
}

/// All keyframes by what they cost, best first.
std::vector<Ranked> compare_all(const PlaceIndex& index, const QueryImage& query) {
  std::vector<Ranked> all;
  for (const IndexedMapPtr& map : index.maps()) {
    for (size_t k = 0; k < map->keyframes.size(); ++k)
      all.push_back({dissimilarity(*map->keyframes[k], query), map.get(), k});
  }
  std::stable_sort(all.begin(), all.end(), [](const Ranked& a, const Ranked& b) { return a.cost < b.cost; });
  return all;
}

std::vector<Ranked> find_similar(const PlaceIndex& index, const QueryImage& query, size_t count,
                                 ImageSearch search) {
  return NearImages(index, query, search).most_similar(count);
}

/// What an index says of where its keyframes are must be so: each once, in its slot or in none.
void expect_consistent(const PlaceIndex& index) {
  std::set<std::pair<MapId, KeyframeId>> known;
  const auto meet = [&](const KeyframePlace& place) {
    ASSERT_EQ(index.find(place.map->snapshot->map), place.map);
    ASSERT_LT(place.keyframe, place.map->keyframes.size());
    EXPECT_TRUE(known.emplace(place.map->snapshot->map, place.map->keyframes[place.keyframe]->id).second);
  };
  for (size_t slot = 0; slot < index.planted().size(); ++slot) {
    const KeyframePlace& place = index.planted()[slot];
    if (place.map == nullptr) continue;
    meet(place);
    EXPECT_EQ(index.forest()->slots()[slot].map, place.map->snapshot->map);
    EXPECT_EQ(index.forest()->slots()[slot].keyframe, place.map->keyframes[place.keyframe]->id);
  }
  for (const KeyframePlace& place : index.unplanted()) meet(place);
  EXPECT_EQ(known.size(), index.keyframe_count());
}

TEST(CompactImage, IsNeverFartherThanTheImageAndLittleNearer) {
  double sum = 0;
  double compact_sum = 0;
  for (uint32_t a = 1; a <= 20; ++a) {
    const QueryImage query = make_query(a, a);
    const IndexedMapPtr map = make_map(a + a % 2, 10);
    for (size_t k = 0; k < map->keyframes.size(); ++k) {
      const float exact = 2 * dissimilarity(*map->keyframes[k], query);
      const float compact = compact_distance(map->images[k], make_compact(query.tiny));
      EXPECT_LE(compact, exact + 1e-5F);
      sum += static_cast<double>(exact);
      compact_sum += static_cast<double>(compact);
    }
  }
  EXPECT_GT(compact_sum, 0.98 * sum);
}

TEST(CompactImage, GainAndBiasDoNotMatter) {
  const LeafPlace place(3);
  EXPECT_LT(compact_distance(make_compact(place.view(2, 3)), make_compact(place.view(2, 3, 0.5F))), 1e-3F);
}

/// An image with fewer pixels than there are frequencies is described wholly by those it has.
TEST(CompactImage, SmallImagesAreKeptWhole) {
  std::mt19937_64 random(5);
  std::vector<TinyImage> images;
  for (int i = 0; i < 10; ++i) {
    GrayImage level3(16, 12);
    for (int y = 0; y < level3.height(); ++y) {
      for (int x = 0; x < level3.width(); ++x) level3.row(y)[x] = static_cast<uint8_t>(random());
    }
    images.emplace_back(level3, 0.0F);
  }
  const QueryImage query(images.back());
  const IndexedMapPtr map = image_map(map_id(1), images);
  for (size_t k = 0; k < images.size(); ++k) {
    EXPECT_NEAR(compact_distance(map->images[k], make_compact(query.tiny)),
                2 * dissimilarity(*map->keyframes[k], query), 1e-4F);
  }
}

TEST(CompactImage, DistanceBeyondALimitIsBeyondIt) {
  const CompactImage a = make_compact(LeafPlace(1).view(0, 0));
  const CompactImage b = make_compact(LeafPlace(2).view(0, 0));
  const float distance = compact_distance(a, b);
  for (const float share : {0.0F, 0.1F, 0.5F, 0.99F})
    EXPECT_GT(compact_distance(a, b, share * distance), share * distance);
  EXPECT_EQ(compact_distance(a, b, distance), distance);
  CompactImage wider = b;
  ++wider.width;
  EXPECT_GT(compact_distance(a, wider), 1e30F);
}

TEST(FindSimilar, AScanIsExact) {
  const PlaceIndex index = make_index(12);
  for (uint32_t place = 1; place <= 18; ++place) {  // six of them are of no map
    const QueryImage query = make_query(place, 100 + place);
    const auto exact = compare_all(index, query);
    for (const size_t images : {size_t{5}, size_t{48}, kImagesNear}) {
      const NearImages near(index, query, ImageSearch::kScan, images);
      for (const size_t count : {size_t{1}, size_t{12}, size_t{500}}) {
        const auto found = near.most_similar(count);
        ASSERT_EQ(found.size(), std::min(count, exact.size()));
        for (size_t i = 0; i < found.size(); ++i)
          EXPECT_TRUE(is_same(found[i], exact[i])) << place << " " << i;
      }
    }
  }
}

/// Where compact images cannot tell images apart, a few of the nearest by them are not enough.
TEST(FindSimilar, AScanIsExactAlsoWhereTheDifferenceIsInHighFrequencies) {
  std::mt19937_64 random(9);
  const auto noisy = [&] {
    GrayImage level3(80, 60);
    for (int y = 0; y < level3.height(); ++y) {
      for (int x = 0; x < level3.width(); ++x)
        level3.row(y)[x] = static_cast<uint8_t>(100 + (x / 2 + y / 2) % 2 * (random() % 64));
    }
    return TinyImage(level3, 0);
  };
  std::vector<TinyImage> images;
  for (int i = 0; i < 400; ++i) images.push_back(noisy());
  PlaceIndex index;
  index.put(image_map(map_id(1), std::move(images)));
  for (int i = 0; i < 5; ++i) {
    const QueryImage query(noisy());
    const auto exact = compare_all(index, query);
    const auto found = find_similar(index, query, 12, ImageSearch::kScan);
    ASSERT_EQ(found.size(), 12U);
    for (size_t k = 0; k < found.size(); ++k) EXPECT_TRUE(is_same(found[k], exact[k])) << i << " " << k;
  }
}

TEST(FindSimilar, OfAnotherSizeOrWithoutContrastThereIsNone) {
  PlaceIndex index = make_index(3);
  for (const bool planted : {false, true}) {
    if (planted) index.set_forest(plant_forest(index, 0, ForestOptions()));
    for (const auto search : {ImageSearch::kScan, ImageSearch::kForest}) {
      EXPECT_TRUE(
          find_similar(index, QueryImage(TinyImage(GrayImage(80, 60), kPlaceBlur)), 12, search).empty());
      GrayImage small(60, 40);
      small.row(20)[30] = 255;
      EXPECT_TRUE(find_similar(index, QueryImage(TinyImage(small, kPlaceBlur)), 12, search).empty());
      EXPECT_TRUE(find_similar({}, make_query(1, 1), 12, search).empty());
    }
  }
}

TEST(FindSimilar, AForestFindsNearlyAllThatAScanFinds) {
  constexpr uint32_t kMaps = 250;
  PlaceIndex index = make_index(kMaps);
  index.set_forest(plant_forest(index, 0, ForestOptions()));
  ASSERT_EQ(index.planted().size(), kMaps * kKeyframes);
  ASSERT_TRUE(index.unplanted().empty());
  size_t wanted = 0;
  size_t found = 0;
  for (uint32_t place = 1; place <= 2 * kMaps; place += 5) {  // half of them are of no map
    const QueryImage query = make_query(place, 7 + place);
    const auto exact = find_similar(index, query, 10, ImageSearch::kScan);
    const auto by_forest = find_similar(index, query, 10, ImageSearch::kForest);
    for (const Ranked& e : exact) {
      ++wanted;
      found += std::any_of(by_forest.begin(), by_forest.end(), [&](const Ranked& f) { return is_same(e, f); })
                   ? 1
                   : 0;
    }
  }
  ASSERT_EQ(wanted, 1000U);
  EXPECT_GE(found, 950U);
}

TEST(FindSimilar, TheMapOfThePlaceIsAmongTheMostSimilarMaps) {
  PlaceIndex index = make_index(30);
  for (const bool planted : {false, true}) {
    if (planted) index.set_forest(plant_forest(index, 0, ForestOptions()));
    for (uint32_t place = 1; place <= 30; ++place) {
      const QueryImage query = make_query(place, 50 + place);
      const auto maps = NearImages(index, query, ImageSearch::kForest, 100).maps();
      EXPECT_LT(maps.size(), 30U);
      EXPECT_EQ(std::count(maps.begin(), maps.end(), index.find(map_id(place))), 1);
      EXPECT_EQ(NearImages(index, query, ImageSearch::kForest, 600).maps().size(), 30U)
          << "there are not more";
    }
  }
}

TEST(FindSimilar, AMapWithImagesOfAnotherSizeMayBeIt) {
  const PlaceIndex index = make_index(30);
  const TinyImage wide(GrayImage(90, 60), kPlaceBlur);
  GrayImage striped(90, 60);
  for (int x = 0; x < 90; ++x) striped.row(20)[x] = 255;
  const auto maps =
      NearImages(index, QueryImage(TinyImage(striped, kPlaceBlur)), ImageSearch::kScan, 100).maps();
  EXPECT_EQ(maps.size(), 30U) << "its words may be there";
  PlaceIndex mixed = index;
  mixed.put(image_map(map_id(99), {wide}));
  mixed.put(image_map(map_id(98), {LeafPlace(98).view(0, 0), wide}));
  const auto with_them = NearImages(mixed, make_query(3, 53), ImageSearch::kScan, 5).maps();
  for (const uint32_t other : {98U, 99U})
    EXPECT_EQ(std::count(with_them.begin(), with_them.end(), mixed.find(map_id(other))), 1);
  EXPECT_LT(with_them.size(), 32U);
}

TEST(FindSimilar, ImagesOfSeveralSizesHaveTheirOwnTrees) {
  PlaceIndex index = make_index(3);
  std::vector<TinyImage> wide;
  for (int i = 0; i < 10; ++i) {
    GrayImage level3(90, 60);
    for (int x = 0; x < 90; ++x) level3.row(5 * i)[x] = 255;
    wide.emplace_back(level3, kPlaceBlur);
  }
  index.put(image_map(map_id(9), wide));
  index.set_forest(plant_forest(index, 0, ForestOptions()));
  EXPECT_EQ(index.planted().size(), 3 * kKeyframes + wide.size());
  const auto found = find_similar(index, QueryImage(wide[7]), 20, ImageSearch::kForest);
  ASSERT_EQ(found.size(), wide.size());
  EXPECT_EQ(found.front().indexed().id, KeyframeId{8});
  for (const Ranked& r : found) EXPECT_EQ(r.map->snapshot->map, map_id(9));
  EXPECT_EQ(find_similar(index, make_query(2, 5), 20, ImageSearch::kForest).size(), 20U);
}

TEST(PlaceIndex, WhatCameAfterTheForestIsFound) {
  PlaceIndex index = make_index(20);
  const ImageForestPtr forest =
      plant_forest(index, 0, ForestOptions());  // "under way" while the index goes on
  index.put(make_map(21));
  index.put(make_map(5, kKeyframes + 1));  // a keyframe more
  index.set_forest(forest);
  index.put(make_map(22));
  index.put(make_map(7, kKeyframes + 2));
  EXPECT_EQ(index.unplanted().size(), 2 * kKeyframes + 3);
  expect_consistent(index);
  for (const auto& [map, keyframe] :
       {std::pair(21U, 0U), {22U, 19U}, {5U, 20U}, {7U, 20U}, {7U, 21U}, {3U, 1U}}) {
    const IndexedMap& shown = *index.find(map_id(map));
    const QueryImage query(shown.keyframes[keyframe]->tiny);
    const auto found = find_similar(index, query, 1, ImageSearch::kForest);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found.front().map, &shown);
    EXPECT_LT(found.front().cost, 1e-4F);
  }
}

/// Whatever is gone: what lives behind it is found, not less.
TEST(PlaceIndex, WhatIsGoneIsNotFoundAndInNobodysWay) {
  PlaceIndex index = make_index(20);
  index.put(make_map(5, 400));
  index.set_forest(plant_forest(index, 0, ForestOptions()));
  const QueryImage query = make_query(5, 77);
  EXPECT_EQ(find_similar(index, query, 12, ImageSearch::kForest).front().map, index.find(map_id(5)));

  PlaceIndex less = index;
  less.put(make_map(5, 3));  // the others have been culled
  expect_consistent(less);
  auto found = find_similar(less, query, 12, ImageSearch::kForest);
  ASSERT_EQ(found.size(), 12U);
  EXPECT_EQ(std::count_if(found.begin(), found.end(),
                          [&](const Ranked& r) { return r.map == less.find(map_id(5)); }),
            3);

  less.remove(map_id(5));
  expect_consistent(less);
  found = find_similar(less, query, 12, ImageSearch::kForest);
  ASSERT_EQ(found.size(), 12U);
  for (const Ranked& r : found) EXPECT_NE(r.map->snapshot->map, map_id(5));
  less.put(make_map(5));  // and undeleted
  expect_consistent(less);
  EXPECT_EQ(find_similar(less, query, 12, ImageSearch::kForest).front().map, less.find(map_id(5)));
  EXPECT_EQ(find_similar(index, query, 12, ImageSearch::kForest).front().map, index.find(map_id(5)))
      << "copies are values";
}

/// As when it is purged and comes back from an archive older than the last of its keyframes.
TEST(PlaceIndex, AMapThatComesBackWithOtherImagesIsFoundByThose) {
  PlaceIndex index = make_index(20);
  index.set_forest(plant_forest(index, 0, ForestOptions()));
  index.remove(map_id(5));
  index.put(image_map(map_id(5), make_images(50, kKeyframes)));
  expect_consistent(index);
  EXPECT_EQ(index.unplanted().size(), kKeyframes);
  const auto found = find_similar(index, make_query(50, 3), 1, ImageSearch::kForest);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found.front().map, index.find(map_id(5)));
}

TEST(PlaceIndex, SaysWhenItNeedsPlanting) {
  PlaceIndex index = make_index(5);
  EXPECT_FALSE(index.needs_planting(5 * kKeyframes));
  EXPECT_EQ(plant_forest(index, 5 * kKeyframes, ForestOptions()), nullptr);
  index.put(make_map(6));
  ASSERT_TRUE(index.needs_planting(5 * kKeyframes));
  index.set_forest(plant_forest(index, 5 * kKeyframes, ForestOptions()));
  EXPECT_FALSE(index.needs_planting(5 * kKeyframes));
  for (uint32_t map = 1; map <= 3; ++map) index.remove(map_id(map));
  EXPECT_FALSE(index.needs_planting(5 * kKeyframes));
  index.remove(map_id(4));  // most of the forest is gone
  ASSERT_TRUE(index.needs_planting(5 * kKeyframes));
  index.set_forest(plant_forest(index, 5 * kKeyframes, ForestOptions()));
  EXPECT_EQ(index.forest(), nullptr);
  EXPECT_FALSE(index.needs_planting(5 * kKeyframes));
  expect_consistent(index);
}

}  // namespace
}  // namespace cairn
