// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/match.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <random>
#include <tuple>

#include "server/relocalization/exact_map.h"

namespace cairn {
namespace {

constexpr int kMaxDistance = 70;
constexpr float kRatio = 0.85F;
constexpr float kSamePlace = 6;  ///< [px of level 0 times 2^level]

using Random = std::mt19937_64;

/// Differs in exactly so many bits, and lies in one of the cells in which the other is looked for.
Descriptor alter(const Descriptor& descriptor, int bits, Random* random) {
  const CellList cells = nearest_cells(descriptor);
  std::array<size_t, 256> order;
  std::iota(order.begin(), order.end(), size_t{0});
  for (;;) {
    Descriptor altered = descriptor;
    std::shuffle(order.begin(), order.end(), *random);
    for (size_t i = 0; i < static_cast<size_t>(bits); ++i)
      altered[order[i] / 64] ^= uint64_t{1} << (order[i] % 64);
    if (std::ranges::find(cells, cell_of(altered)) != cells.end()) return altered;
  }
}

struct DrawnPoint {
  DescribedPoint point;
  Descriptor descriptor{};
  CellId cell = 0;
};

/// A map of one keyframe whose points are described as told. Point 3, 13, ... has left the map.
class DrawnMap {
 public:
  /// Described at `scale`.
  void add(const Descriptor& descriptor, int scale, const Eigen::Vector2f& pixel) {
    const auto number = static_cast<uint32_t>(sightings_.size());
    Sighting& sighting = sightings_.emplace_back();
    sighting.pixel = pixel;
    sighting.level = static_cast<uint8_t>(scale / 2);
    drawn_.push_back({{number, static_cast<uint8_t>(scale)}, descriptor, cell_of(descriptor)});
  }
  /// The last one at another scale.
  void describe_again(const Descriptor& descriptor, int scale) {
    DrawnPoint again = drawn_.back();
    again.point.scale = static_cast<uint8_t>(scale);
    again.descriptor = descriptor;
    again.cell = cell_of(descriptor);
    drawn_.push_back(again);
  }
  [[nodiscard]] IndexedMap index() {
    std::ranges::sort(
        drawn_, {}, [](const DrawnPoint& d) { return std::tuple(d.cell, d.point.scale, d.point.measured); });
    auto keyframe = std::make_shared<IndexedKeyframe>();
    keyframe->sightings = sightings_;
    for (uint64_t number = 1; number <= sightings_.size(); ++number)
      keyframe->measured.push_back(PointId{number});
    DescribedPoints& points = keyframe->as_taken;
    for (const DrawnPoint& d : drawn_) {
      points.points.push_back(d.point);
      points.descriptors.push_back(d.descriptor);
      ++points.begin_of[size_t{d.cell} * kPlaceScales + d.point.scale + 1];
    }
    std::partial_sum(points.begin_of.begin(), points.begin_of.end(), points.begin_of.begin());
    IndexedMap map;
    map.keyframes = {keyframe};
    map.positions.resize(1);
    for (size_t i = 0; i < sightings_.size(); ++i) {
      const float x = i % 10 == 3 ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(i);
      map.positions[0].emplace_back(x, 1, 2);
    }
    return map;
  }

 private:
  std::vector<Sighting> sightings_;  ///< of point 1, 2, ...
  std::vector<DrawnPoint> drawn_;
};

/// What a corner's answer depended on.
struct Tally {
  int matched = 0;
  int too_far = 0;
  int refused = 0;
  int tied = 0;    ///< as near as the one that is matched
  int spared = 0;  ///< refused if what is at the same place were a rival
};

/// The rule of match_closer(), one point after the other and none left out.
class PlainRule {
 public:
  explicit PlainRule(const IndexedMap& map) : map_(map), keyframe_(*map.keyframes[0]) {
    for (const Descriptor& d : as_taken().descriptors) cells_.push_back(cell_of(d));
  }

  [[nodiscard]] std::vector<PlaceMatch> match(const PlaceView& view) {
    std::map<PointId, PlaceMatch> of_point;
    for (size_t i = 0; i < view.corners.size(); ++i) {
      const auto best = find(view.corners[i]);
      if (!best) continue;
      const uint32_t point = as_taken().points[best->index].measured;
      const Eigen::Vector3f& position = map_.positions[0][point];
      if (!position.allFinite()) continue;
      const PointId id = keyframe_.measured[point];
      const PlaceMatch match{i, id, position.cast<double>(), best->distance, sighting_of(best->index).pixel};
      PlaceMatch& nearest = of_point.try_emplace(id, match).first->second;
      if (match.distance < nearest.distance) nearest = match;
    }
    std::vector<PlaceMatch> matches;
    for (const auto& [id, match] : of_point) matches.push_back(match);
    std::ranges::sort(matches, {}, &PlaceMatch::corner);
    return matches;
  }
  [[nodiscard]] const Tally& tally() const { return tally_; }

 private:
  [[nodiscard]] const DescribedPoints& as_taken() const { return keyframe_.as_taken; }
  [[nodiscard]] const Sighting& sighting_of(size_t description) const {
    return keyframe_.sightings[as_taken().points[description].measured];
  }
  [[nodiscard]] bool are_rivals(size_t a, size_t b) const {
    const Sighting& p = sighting_of(a);
    const Sighting& q = sighting_of(b);
    return as_taken().points[a].scale == as_taken().points[b].scale ||
           (p.pixel - q.pixel).norm() > kSamePlace * static_cast<float>(1 << p.level);
  }
  /// In the order in which they are looked at.
  [[nodiscard]] std::vector<NearDescriptor> comparable(const PlaceCorner& corner) const {
    std::vector<NearDescriptor> points;
    for (const CellId cell : nearest_cells(corner.descriptor)) {
      for (uint32_t i = 0; i < cells_.size(); ++i) {
        if (cells_[i] == cell && std::abs(as_taken().points[i].scale - 2 * corner.level) <= 2)
          points.push_back({i, descriptor_distance(corner.descriptor, as_taken().descriptors[i])});
      }
    }
    return points;
  }
  std::optional<NearDescriptor> find(const PlaceCorner& corner) {
    const std::vector<NearDescriptor> points = comparable(corner);
    std::optional<NearDescriptor> best;
    int rival = 257;
    for (const NearDescriptor& p : points) {
      if (p.distance >= rival) continue;
      const bool rivals = best && are_rivals(p.index, best->index);
      if (!best || p.distance < best->distance) {
        if (rivals) rival = best->distance;
        best = p;
      } else if (rivals) {
        rival = p.distance;
      }
    }
    if (!best) return std::nullopt;
    return judge(points, *best, rival) ? best : std::nullopt;
  }
  bool judge(const std::vector<NearDescriptor>& points, const NearDescriptor& best, int rival) {
    const auto is_clear_of = [&](int other) {
      return static_cast<float>(best.distance) <= kRatio * static_cast<float>(other);
    };
    if (best.distance > kMaxDistance) return ++tally_.too_far, false;
    if (!is_clear_of(rival)) return ++tally_.refused, false;
    ++tally_.matched;
    const auto any = [&](const auto& holds) {
      return std::ranges::any_of(points,
                                 [&](const NearDescriptor& p) { return p.index != best.index && holds(p); });
    };
    tally_.tied += any([&](const NearDescriptor& p) { return p.distance == best.distance; }) ? 1 : 0;
    tally_.spared += any([&](const NearDescriptor& p) { return !is_clear_of(p.distance); }) ? 1 : 0;
    return true;
  }

  const IndexedMap& map_;
  const IndexedKeyframe& keyframe_;
  std::vector<CellId> cells_;
  Tally tally_;
};

void expect_same(const std::vector<PlaceMatch>& found, const std::vector<PlaceMatch>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].corner, expected[i].corner);
    EXPECT_EQ(found[i].point, expected[i].point);
    EXPECT_EQ(found[i].position, expected[i].position);
    EXPECT_EQ(found[i].distance, expected[i].distance);
    EXPECT_EQ(found[i].there, expected[i].there);
  }
}

/// Corners, each with some points that are about as much like it, at one place or elsewhere; some corners
/// have those of the one before, too.
PlaceView draw_view(DrawnMap* map, Random* random) {
  constexpr int kCorners = 300;
  const auto below = [&](int end) { return static_cast<int>((*random)() % static_cast<uint64_t>(end)); };
  const auto pixel = [&] {
    return Eigen::Vector2f(static_cast<float>(below(640)), static_cast<float>(below(480)));
  };
  PlaceView view;
  Descriptor look = kWords[0];
  for (int c = 0; c < kCorners; ++c) {
    look = below(5) == 0 ? alter(look, below(12), random)
                         : alter(kWords[static_cast<size_t>(below(kVocabularyWords))], below(40), random);
    const int level = below(kPyramidLevels);
    view.corners.push_back({pixel(), static_cast<uint8_t>(level), look});
    const auto scale = [&] { return std::clamp(2 * level + below(7) - 3, 0, kPlaceScales - 1); };
    const Eigen::Vector2f place = pixel();
    const int nearest = below(90);
    for (int points = below(5); points > 0; --points) {
      const Eigen::Vector2f aside(static_cast<float>(below(12)), 0);
      map->add(alter(look, nearest + below(4) * below(8), random), scale(),
               below(2) == 0 ? (place + aside).eval() : pixel());
      if (below(3) == 0) map->describe_again(alter(look, nearest + below(8), random), scale());
    }
  }
  return view;
}

TEST(Match, WhatIsFoundIsWhatThePlainRuleFinds) {
  Tally sum;
  for (const unsigned seed : {1, 2, 3, 4, 5, 6}) {
    SCOPED_TRACE(seed);
    Random random(seed);
    DrawnMap drawn;
    const PlaceView view = draw_view(&drawn, &random);
    const IndexedMap map = drawn.index();
    PlainRule plain(map);
    const auto expected = plain.match(view);
    expect_same(testing::match_all(view, map, 0), expected);
    EXPECT_LT(expected.size(), static_cast<size_t>(plain.tally().matched)) << "points gone, or wanted twice";
    sum.too_far += plain.tally().too_far;
    sum.refused += plain.tally().refused;
    sum.matched += plain.tally().matched;
    sum.tied += plain.tally().tied;
    sum.spared += plain.tally().spared;
  }
  EXPECT_GT(sum.matched, 300);
  EXPECT_GT(sum.too_far, 100);
  EXPECT_GT(sum.refused, 100);
  EXPECT_GT(sum.tied, 30);
  EXPECT_GT(sum.spared, 30);
}

/// One point, and another.
struct Pair {
  const char* what;
  int distance;
  int other_distance;  ///< 0: there is none
  int other_scale;     ///< the one's: 0
  float apart;         ///< [px]
  bool is_matched;
};

TEST(Match, WhatIsOnTheEdgeOfTheRule) {
  for (const Pair& pair : std::initializer_list<Pair>{
           {"the limit", 70, 0, 0, 0, true},
           {"beyond the limit", 71, 0, 0, 0, false},
           {"the farthest rival that refuses what is at the limit", 70, 82, 0, 50, false},
           {"a rival too far to refuse anything", 70, 83, 0, 50, true},
           {"just clear of the rival", 17, 20, 0, 50, true},
           {"not clear of the rival", 17, 19, 0, 50, false},
           {"two alike, elsewhere", 30, 30, 1, 50, false},
           {"two alike of one scale at one place", 30, 30, 0, 0, false},
           {"two alike of one place at two scales", 30, 30, 1, 0, true},
           {"as far apart as one place is wide", 30, 31, 1, 6, true},
           {"farther apart", 30, 31, 1, 6.25F, false},
       }) {
    SCOPED_TRACE(pair.what);
    Random random(7);
    const Descriptor look = kWords[100];
    DrawnMap drawn;
    drawn.add(alter(look, pair.distance, &random), 0, {100, 100});
    if (pair.other_distance > 0)
      drawn.add(alter(look, pair.other_distance, &random), pair.other_scale, {100 + pair.apart, 100});
    PlaceView view;
    view.corners.push_back({{50, 60}, 0, look});
    const IndexedMap map = drawn.index();
    const auto found = testing::match_all(view, map, 0);
    EXPECT_EQ(found.size(), pair.is_matched ? 1U : 0U);
    expect_same(found, PlainRule(map).match(view));
  }
}

}  // namespace
}  // namespace cairn
