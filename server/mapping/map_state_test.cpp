// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_state.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>

#include "server/mapping/upkeep.h"

namespace cairn {
namespace {

CameraPtr test_camera() {
  CameraParameters p;
  p.width = 640;
  p.height = 480;
  p.values = {500, 500, 319.5, 239.5};
  return *make_camera(p);
}

/// Adds a keyframe looking along z from the given x.
KeyframeId add_keyframe(MapState* map, double x) {
  MapKeyframe k;
  k.camera = test_camera();
  k.camera_from_map = SE3(Eigen::Quaterniond::Identity(), {-x, 0, 0});
  return map->add_keyframe(std::move(k));
}

PointId add_point(MapState* map, KeyframeId source, const Eigen::Vector3d& position) {
  PointSource s;
  s.keyframe = source;
  return map->add_point(s, position);
}

/// The joins agree in both directions, and nothing dead takes part in them.
void expect_consistent(const MapState& map) {
  for (const MapKeyframe& k : map.keyframes()) {
    EXPECT_TRUE(std::is_sorted(k.measurements.begin(), k.measurements.end(),
                               [](const Measurement& a, const Measurement& b) { return a.point < b.point; }));
    if (!k.live) {
      EXPECT_TRUE(k.measurements.empty());
    }
    for (const Measurement& m : k.measurements) {
      EXPECT_TRUE(map.is_live(m.point));
      const auto& observers = map.point(m.point).observers;
      EXPECT_TRUE(std::binary_search(observers.begin(), observers.end(), k.id));
    }
    for (const PointId point : k.given_up) EXPECT_TRUE(map.is_live(point));
  }
  for (const MapPoint& p : map.points()) {
    EXPECT_EQ(p.source != nullptr, p.live);
    if (!p.live) {
      EXPECT_TRUE(p.observers.empty());
    }
    EXPECT_TRUE(std::is_sorted(p.observers.begin(), p.observers.end()));
    for (const KeyframeId id : p.observers) EXPECT_NE(map.find_measurement(id, p.id), nullptr);
  }
  std::vector<PointId> live;
  for (const MapPoint& p : map.points()) {
    if (p.live) live.push_back(p.id);
  }
  EXPECT_EQ(map.live_point_ids(), live);
}

TEST(MapState, JoinsStayConsistentUnderRandomChanges) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    SCOPED_TRACE(seed);
    std::mt19937_64 random(seed);
    MapState map;
    for (int i = 0; i < 8; ++i) add_keyframe(&map, 0.1 * i);
    for (int i = 0; i < 60; ++i) {
      const KeyframeId source{1 + random() % 8};
      const PointId point = add_point(&map, source, {0, 0, 1});
      map.add_measurement(source, {point, 0, {1, 1}});
      for (uint64_t k = 1; k <= 8; ++k) {
        if (random() % 2 == 0) map.add_measurement(KeyframeId{k}, {point, 0, {1, 1}});
      }
    }
    expect_consistent(map);
    for (int i = 0; i < 60; ++i) {
      const PointId point{1 + random() % 60};
      const KeyframeId keyframe{1 + random() % 8};
      switch (random() % 8) {
        case 0:
          map.remove_point(point);
          break;
        case 1:
          map.remove_keyframe(keyframe);
          break;
        default:
          map.drop_measurement(keyframe, point);
      }
      expect_consistent(map);
    }
    EXPECT_LT(map.live_points(), 60U);
  }
}

TEST(MapState, APointDiesWithItsSourceOrItsSecondObserver) {
  MapState map;
  for (int i = 0; i < 3; ++i) add_keyframe(&map, 0.1 * i);
  const KeyframeId source{1};
  const PointId a = add_point(&map, source, {0, 0, 1});
  const PointId b = add_point(&map, source, {0, 0, 1});
  for (uint64_t k = 1; k <= 3; ++k) {
    map.add_measurement(KeyframeId{k}, {a, 0, {1, 1}});
    map.add_measurement(KeyframeId{k}, {b, 0, {1, 1}});
  }
  map.drop_measurement(source, a);
  EXPECT_FALSE(map.is_live(a));
  map.drop_measurement(KeyframeId{2}, b);
  EXPECT_TRUE(map.is_live(b));
  EXPECT_TRUE(map.has_given_up(KeyframeId{2}, b));
  map.drop_measurement(KeyframeId{3}, b);
  EXPECT_FALSE(map.is_live(b));
}

TEST(MapState, TransformKeepsWhatCamerasSee) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal(0, 0.3);
  MapState map;
  add_keyframe(&map, 0);
  add_keyframe(&map, 0.2);
  for (int i = 0; i < 20; ++i) {
    const PointId id = add_point(&map, KeyframeId{1}, {normal(random), normal(random), 1.5});
    for (uint64_t k = 1; k <= 2; ++k) map.add_measurement(KeyframeId{k}, {id, 0, {1, 1}});
  }
  map.update_depths(KeyframeId{1});
  const MapState before = map;
  map.transform({2.5, so3_exp({0.3, -0.4, 0.5}), {1, 2, 3}});
  for (const MapKeyframe& k : map.keyframes()) {
    for (const MapPoint& p : map.points()) {
      const auto now = k.camera->project(k.camera_from_map * p.position);
      const auto then =
          k.camera->project(before.keyframe(k.id).camera_from_map * before.point(p.id).position);
      ASSERT_TRUE(now && then);
      EXPECT_LT((*now - *then).norm(), 1e-9);
    }
  }
  EXPECT_NEAR(map.keyframe(KeyframeId{1}).mean_depth, 2.5 * before.keyframe(KeyframeId{1}).mean_depth, 1e-12);
  const double mean_before_update = map.keyframe(KeyframeId{1}).mean_depth;
  map.update_depths(KeyframeId{1});
  EXPECT_NEAR(map.keyframe(KeyframeId{1}).mean_depth, mean_before_update, 1e-9);
}

TEST(Upkeep, CullsPointsThatAreSearchedInVain) {
  MapState map;
  add_keyframe(&map, 0);
  add_keyframe(&map, 0.1);
  for (int found = 0; found <= 8; ++found) {
    const PointId id = add_point(&map, KeyframeId{1}, {0, 0, 1});
    for (uint64_t k = 1; k <= 2; ++k) map.add_measurement(KeyframeId{k}, {id, 0, {1, 1}});
    map.point(id).attempts = 8;
    map.point(id).found = found;
  }
  EXPECT_EQ(cull_points(&map, UpkeepOptions()), 2);
  EXPECT_FALSE(map.is_live(PointId{1}));
  EXPECT_FALSE(map.is_live(PointId{2}));
  EXPECT_TRUE(map.is_live(PointId{3}));
}

TEST(Upkeep, FindsTheKeyframeThatAddsNothing) {
  MapState map;
  for (int i = 0; i < 12; ++i) add_keyframe(&map, 0.1 * i);
  // Points of each keyframe are seen from its next; those of keyframe 1 from everywhere, so that keyframe 4,
  // which sees nothing else once its own points are left out, is dispensable.
  for (uint64_t source = 1; source <= 11; ++source) {
    if (source == 3 || source == 4) continue;
    for (int i = 0; i < 20; ++i) {
      const PointId id = add_point(&map, KeyframeId{source}, {0, 0, 1});
      map.add_measurement(KeyframeId{source}, {id, 0, {1, 1}});
      for (uint64_t k = source + 1; k <= (source == 1 ? 12U : source + 1); ++k) {
        if (source == 1 && k == 3) continue;
        map.add_measurement(KeyframeId{k}, {id, 0, {1, 1}});
      }
    }
  }
  EXPECT_EQ(find_redundant_keyframe(map, KeyframeId{12}, UpkeepOptions()), KeyframeId{4});
  map.remove_keyframe(KeyframeId{4});
  EXPECT_EQ(map.live_points(), 180U);
  EXPECT_EQ(find_redundant_keyframe(map, KeyframeId{12}, UpkeepOptions()), std::nullopt);
}

/// What a map says, whatever its ids are: of each keyframe its centre, of each point its position, and who
/// measures what where.
std::multiset<std::array<double, 4>> joins_of(const MapState& map) {
  std::multiset<std::array<double, 4>> joins;
  for (const MapKeyframe& k : map.keyframes()) {
    if (!k.live) continue;
    const double x = k.camera_from_map.center().x();
    joins.insert({x, 0, 0, 0});
    for (const Measurement& m : k.measurements)
      joins.insert({x, map.point(m.point).position.x(), m.pixel.x(), m.pixel.y()});
    for (const PointId id : k.given_up) joins.insert({x, map.point(id).position.x(), -1, -1});
  }
  for (const PointId id : map.live_point_ids()) {
    const MapPoint& p = map.point(id);
    const double source_x = map.keyframe(p.source->keyframe).camera_from_map.center().x();
    joins.insert({p.position.x(), source_x, static_cast<double>(p.attempts), static_cast<double>(p.found)});
  }
  return joins;
}

/// A map in which, for a year, as much is culled as is made.
class BusyMap {
 public:
  explicit BusyMap(uint64_t seed) : random_(seed) {
    for (int i = 0; i < 6; ++i) grow();
  }
  void grow() {
    const KeyframeId id = add_keyframe(&map_, next_x_ += 1);
    map_.keyframe(id).reference = id == KeyframeId{1} ? KeyframeId{} : some_live_before(id);
    for (int i = 0; i < 30; ++i) {
      const PointId point = add_point(&map_, id, {next_x_ += 1, 0, 1});
      map_.point(point).attempts = static_cast<int>(random_() % 20);
      map_.add_measurement(id, {point, 0, {1, static_cast<float>(i)}});
      map_.add_measurement(some_live_before(id), {point, 0, {2, static_cast<float>(i)}});
      if (random_() % 4 == 0) map_.give_up(some_live_before(id), point);
    }
  }
  void cull() {
    while (map_.live_keyframes() > 6) {
      const KeyframeId id{3 + random_() % (map_.keyframes().size() - 2)};
      map_.remove_keyframe(id);
    }
    while (map_.live_points() > 100) map_.remove_point(map_.live_point_ids()[random_() % map_.live_points()]);
  }
  [[nodiscard]] MapState& map() { return map_; }

 private:
  [[nodiscard]] KeyframeId some_live_before(KeyframeId id) {
    if (id <= KeyframeId{1}) return id;
    KeyframeId other{1 + random_() % (id.value - 1)};
    while (!map_.is_live(other)) other = KeyframeId{other.value - 1};  // the first lives always
    return other;
  }
  std::mt19937_64 random_;
  MapState map_;
  double next_x_ = 0;
};

TEST(MapState, AMapThatIsCompactedNowAndThenNeverRunsOutOfPlaces) {
  BusyMap busy(5);
  MapState& map = busy.map();
  size_t points_made = 0;
  for (int round = 0; round < 3000; ++round) {
    const size_t before = map.points().size();
    busy.grow();
    points_made += map.points().size() - before;
    busy.cull();
    if (round % 10 != 0) continue;
    const auto joins = joins_of(map);
    const std::vector<PointId> live = map.live_point_ids();
    std::vector<double> positions;
    for (const PointId id : live) positions.push_back(map.point(id).position.x());
    const Renumbering now = map.compact();
    ASSERT_EQ(map.points().size(), map.live_points());
    ASSERT_EQ(map.keyframes().size(), map.live_keyframes());
    ASSERT_TRUE(joins_of(map) == joins) << "in round " << round;
    for (size_t i = 0; i < live.size(); ++i) {
      ASSERT_EQ(map.point(now.of(live[i])).position.x(), positions[i]);
      ASSERT_EQ(map.point(now.of(live[i])).source->id, now.of(live[i]));
    }
    for (const MapKeyframe& k : map.keyframes()) {
      ASSERT_EQ(&map.keyframe(k.id), &k);
      ASSERT_TRUE(k.id == KeyframeId{1} ? !k.reference : k.reference < k.id && map.is_live(k.reference));
    }
    if (round % 500 == 0) expect_consistent(map);
    ASSERT_FALSE(now.of(PointId{live.back().value + 1000}));
  }
  EXPECT_GT(points_made, 50'000U);
  EXPECT_LT(map.points().size(), 1000U);
}

}  // namespace
}  // namespace cairn
