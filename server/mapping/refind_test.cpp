// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/refind.h"

#include <gtest/gtest.h>

#include "server/mapping/patch_view.h"
#include "server/mapping/test_scene.h"
#include "server/mapping/upkeep.h"

namespace cairn::testing {
namespace {

constexpr int kViews = 6;  ///< as many as a point must be missed in before it is judged
constexpr size_t kEnough = 10;

/// A map with true poses and positions. Keyframe 1 looks past the board; from the others the back that it saw
/// there is behind the board, 1.6 times as far. Those measure points of the board.
class RefindTest : public ::testing::Test {
 protected:
  RefindTest() {
    add_keyframe(-0.2);
    for (int i = 0; i < kViews; ++i) add_keyframe(0.03 * i);
  }

  static SE3 pose(double x) { return {Eigen::Quaterniond::Identity(), {-x, 0, -0.4}}; }

  KeyframeId add_keyframe(double x) {
    MapKeyframe k;
    k.camera = scene_.camera();
    k.camera_from_map = pose(x);
    k.images = view_of(k.camera_from_map, map_.keyframes().size());
    return map_.add_keyframe(std::move(k));
  }
  /// Rendered once for all tests, which have the same views.
  std::shared_ptr<const KeyframeImages> view_of(const SE3& camera_from_world, size_t index) const {
    static std::vector<std::shared_ptr<const KeyframeImages>> views;
    if (index == views.size())
      views.push_back(prepare_images(scene_.render(camera_from_world, index)->view()));
    return views[index];
  }
  [[nodiscard]] std::vector<KeyframeId> later_views() const {
    std::vector<KeyframeId> ids;
    for (uint64_t i = 0; i < kViews; ++i) ids.push_back(KeyframeId{i + 2});
    return ids;
  }
  [[nodiscard]] bool sees(KeyframeId view, const Eigen::Vector3d& point) const {
    return scene_.sees(map_.keyframe(view).camera_from_map, point);
  }
  [[nodiscard]] bool is_in_picture(KeyframeId view, const Eigen::Vector3d& point) const {
    constexpr double kRim = 20;
    const auto pixel = scene_.camera()->project(map_.keyframe(view).camera_from_map * point);
    return pixel && scene_.camera()->in_image(*pixel, kRim);
  }
  /// How many of the later views see a point that lies in the pictures of all; -1 for another.
  [[nodiscard]] int observers_of(const Eigen::Vector3d& point) const {
    int observers = 0;
    for (const KeyframeId view : later_views()) {
      if (!is_in_picture(view, point)) return -1;
      observers += sees(view, point) ? 1 : 0;
    }
    return observers;
  }

  /// Points at the corners of a view where the scene is so deep, seen by so many of the later ones.
  std::vector<PointId> add_points(KeyframeId view, double depth, int observers) {
    std::vector<PointId> ids;
    const MapKeyframe& keyframe = map_.keyframe(view);
    for (const Candidate& c : point_candidates(*keyframe.images, 0)) {
      const Eigen::Vector2d pixel(c.corner.x, c.corner.y);
      const Eigen::Vector3d point = scene_.hit(keyframe.camera_from_map, pixel);
      const auto source = make_source(keyframe, 0, c.corner);
      if (!source || std::abs(point.z() - depth) > 1e-6 || observers_of(point) != observers) continue;
      ids.push_back(map_.add_point(*source, point));
      map_.add_measurement(view, {ids.back(), 0, pixel.cast<float>()});
    }
    return ids;
  }
  /// Every later view measures a point of the board each 12 px.
  void measure_board() {
    for (const KeyframeId view : later_views()) {
      const MapKeyframe& keyframe = map_.keyframe(view);
      for (int y = 6; y < scene_.camera()->height(); y += 12) {
        for (int x = 6; x < scene_.camera()->width(); x += 12) {
          const Eigen::Vector3d point = scene_.hit(keyframe.camera_from_map, {x, y});
          if (std::abs(point.z() - Scene::kFrontDepth) > 1e-6) continue;
          PointSource source;
          source.keyframe = view;
          map_.add_measurement(view, {map_.add_point(source, point), 0, Eigen::Vector2f(x, y)});
        }
      }
    }
  }
  [[nodiscard]] size_t given_up(PointId point) const {
    size_t count = 0;
    for (const KeyframeId view : later_views()) count += map_.has_given_up(view, point) ? 1 : 0;
    return count;
  }

  Scene scene_{11};
  MapState map_;
};

TEST_F(RefindTest, APointHiddenInSixKeyframesStays) {
  const std::vector<PointId> hidden = add_points(KeyframeId{1}, Scene::kBackDepth, 0);
  ASSERT_GT(hidden.size(), kEnough);
  measure_board();
  for (const KeyframeId view : later_views()) (void)Refinder(&map_).refind_all(view);
  (void)cull_points(&map_);
  for (const PointId id : hidden) {
    EXPECT_TRUE(map_.is_live(id));
    EXPECT_EQ(map_.point(id).attempts, map_.point(id).found) << "a miss was counted";
    EXPECT_EQ(given_up(id), 0U);
  }
}

/// The control: they are looked for there, and what hides them must be known.
TEST_F(RefindTest, WithNothingKnownInFrontTheyAreMissed) {
  const std::vector<PointId> hidden = add_points(KeyframeId{1}, Scene::kBackDepth, 0);
  ASSERT_GT(hidden.size(), kEnough);
  for (const KeyframeId view : later_views()) (void)Refinder(&map_).refind_all(view);
  size_t missed = 0;
  for (const PointId id : hidden) missed += map_.point(id).attempts > map_.point(id).found ? 1 : 0;
  EXPECT_GT(2 * missed, hidden.size());
}

TEST_F(RefindTest, SoDoesANewPointThatOldKeyframesDoNotSee) {
  const std::vector<PointId> hidden = add_points(KeyframeId{1}, Scene::kBackDepth, 0);
  ASSERT_GT(hidden.size(), kEnough);
  measure_board();
  Refinder refinder(&map_);
  for (const PointId id : hidden) {
    for (const KeyframeId view : later_views()) (void)refinder.refind(view, id);
    EXPECT_EQ(map_.point(id).attempts, map_.point(id).found);
    EXPECT_EQ(given_up(id), 0U);
  }
}

TEST_F(RefindTest, APointInFullViewIsFound) {
  const std::vector<PointId> seen = add_points(KeyframeId{1}, Scene::kBackDepth, kViews);
  ASSERT_GT(seen.size(), kEnough);
  measure_board();
  for (const KeyframeId view : later_views()) (void)Refinder(&map_).refind_all(view);
  int found = 0;
  for (const PointId id : seen) found += map_.point(id).found;
  EXPECT_GT(found, 0.8 * kViews * static_cast<double>(seen.size()));
}

/// Along the rays of the keyframe in which they were made, so that it sees them where it did.
void move_along_rays(const std::vector<PointId>& points, double factor, MapState* map) {
  for (const PointId id : points) {
    MapPoint& point = map->point(id);
    const Eigen::Vector3d center = map->keyframe(point.source.keyframe).camera_from_map.center();
    point.position = center + factor * (point.position - center);
  }
}

TEST_F(RefindTest, APointBeforeTheBoardThatIsNotThereGoes) {
  const std::vector<PointId> wrong = add_points(KeyframeId{1}, Scene::kBackDepth, 0);
  move_along_rays(wrong, 0.5, &map_);  // nearer to the camera than anything is
  measure_board();
  for (const KeyframeId view : later_views()) (void)Refinder(&map_).refind_all(view);
  size_t missed = 0;
  for (const PointId id : wrong) missed += given_up(id);
  EXPECT_GT(missed, wrong.size());
  EXPECT_GT(cull_points(&map_), 0);
}

}  // namespace
}  // namespace cairn::testing
