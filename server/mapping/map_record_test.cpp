// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_record.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "server/mapping/map_maker_fixture.h"

namespace cairn {
namespace {

using testing::bytes_of;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kNeverYield;

/// Replaces or adds by key: what a store does with rows.
template <typename Row, typename Key>
void put(std::vector<Row>* rows, const std::vector<Row>& changed, Key key) {
  for (const Row& row : changed) {
    const auto same = [&](const Row& r) { return key(r) == key(row); };
    const auto it = std::find_if(rows->begin(), rows->end(), same);
    if (it == rows->end()) {
      rows->push_back(row);
    } else {
      *it = row;
    }
  }
}

void apply(const MapRecord& changes, MapRecord* whole) {
  put(&whole->calibrated_cameras, changes.calibrated_cameras, [](const auto& r) { return r.index; });
  whole->keyframe_count = changes.keyframe_count;
  whole->point_count = changes.point_count;
  if (changes.foundation) whole->foundation = changes.foundation;
  if (changes.work) whole->work = changes.work;
  put(&whole->keyframes, changes.keyframes, [](const auto& r) { return r.id; });
  put(&whole->measurements, changes.measurements, [](const auto& r) { return r.keyframe; });
  put(&whole->images, changes.images, [](const auto& r) { return r.keyframe; });
  put(&whole->sources, changes.sources, [](const auto& r) { return r.block; });
  put(&whole->positions, changes.positions, [](const auto& r) { return r.block; });
  for (const KeyframeId id : changes.removed_images)
    std::erase_if(whole->images, [id](const ImageRecord& r) { return r.keyframe == id; });
}

template <typename T>
void drop_at(std::vector<T>* rows, size_t index) {
  ASSERT_LT(index, rows->size());
  rows->erase(rows->begin() + static_cast<ptrdiff_t>(index));
}

class MapRecordTest : public testing::MapMakerFixture {
 protected:
  static constexpr Epoch kNextEpoch{2};

  void grow() {
    start();
    for (int step = 5; step <= 14; step += 3) ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
  }
  [[nodiscard]] Result<MapMaker::Restored> restore(const MapRecord& record) const {
    return MapMaker::restore(record, {input_.map, input_.map_name, kNextEpoch}, options_);
  }
  /// The map as it is, cut into blocks anew: published ones lag what moved by less than can be seen.
  [[nodiscard]] std::vector<uint8_t> state_of(MapMaker* map) const {
    map->keep_everything_anew();
    const auto copy = restore(map->take_changes());
    return copy ? bytes_of(*copy->maker->snapshot()) : std::vector<uint8_t>();
  }
  /// Does one thing to both maps and expects them to stay equal.
  template <typename Act>
  void expect_same(MapMaker* a, MapMaker* b, Act act) {
    act(a);
    act(b);
    EXPECT_TRUE(state_of(a) == state_of(b));
  }
};

TEST_F(MapRecordTest, ARestoredMapGoesOnAsTheOriginalWouldHave) {
  mask_left_of(80);
  start();
  ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  // In the midst of its work: one keyframe with some of its points, none re-found yet.
  const KeyframeInput newest = testing::make_offer(scene_, *maker_->snapshot(), 8);
  ASSERT_EQ(maker_->add_keyframe(newest).verdict, KeyframeVerdict::kAccepted);
  int polls = 0;
  ASSERT_FALSE(maker_->step([&] { return ++polls > 3; }).finished);

  const auto restored = restore(maker_->take_changes());
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_THAT(restored->repairs, IsEmpty());
  MapMaker* copy = restored->maker.get();
  EXPECT_EQ(copy->snapshot()->epoch, kNextEpoch);
  EXPECT_EQ(copy->statistics().measurements, maker_->statistics().measurements);

  const auto finish_work = [](MapMaker* maker) {
    while (maker->step(kNeverYield).work != MapWork::kNone) {
    }
  };
  expect_same(maker_.get(), copy, finish_work);
  expect_same(maker_.get(), copy, [](MapMaker* maker) {
    ASSERT_TRUE(maker->wants_global_adjustment());
    const GlobalAdjustmentPtr problem = maker->prepare_global_adjustment();
    solve(problem.get(), {});
    maker->adopt(*problem);
  });
  const KeyframeInput next = testing::make_offer(scene_, *maker_->snapshot(), 11);
  expect_same(maker_.get(), copy, [&](MapMaker* maker) {
    ASSERT_EQ(maker->add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    finish_work(maker);
  });
}

TEST_F(MapRecordTest, ARestoredMapGoesOnFindingOutItsCamera) {
  constexpr double kBelieved = 1.04;
  use_prior(kBelieved);
  grow();
  MapRecord kept = maker_->take_changes();
  const PointSource first = kept.sources.at(0).points.at(0);
  const auto restored = restore(kept);
  ASSERT_TRUE(restored) << restored.error().message;
  MapMaker* copy = restored->maker.get();
  for (MapMaker* maker : {maker_.get(), copy}) {
    const GlobalAdjustmentPtr problem = maker->prepare_global_adjustment();
    solve(problem.get(), {});
    maker->adopt(*problem);
  }
  apply(maker_->take_changes(), &kept);
  EXPECT_TRUE(state_of(maker_.get()) == state_of(copy));
  const MapSnapshotPtr snapshot = maker_->snapshot();
  ASSERT_EQ(copy->snapshot()->cameras, snapshot->cameras);
  const CameraEstimate found = maker_->statistics().cameras.at(0);
  EXPECT_GT(found.version.version, 1U);
  EXPECT_NE(found.camera->focal_length(), input_.camera->focal_length());
  EXPECT_EQ(copy->statistics().cameras.at(0).camera->parameters(), found.camera->parameters());

  // What the adjustment has changed is kept: values, and with them the rays of points made before.
  apply(maker_->take_changes(), &kept);
  const auto later = restore(kept);
  ASSERT_TRUE(later);
  const CameraEstimate again = later->maker->statistics().cameras.at(0);
  EXPECT_EQ(again.version, found.version);
  EXPECT_EQ(again.sigma, found.sigma);
  constexpr double kUnseen = 0.2;  // [px] below which a camera is not told again
  EXPECT_NEAR(again.camera->focal_length(), found.camera->focal_length(), kUnseen);
  const PointSource& before = snapshot->point_blocks.at(0)->patches->points.at(0);
  const PointSource& after = later->maker->snapshot()->point_blocks.at(0)->patches->points.at(0);
  EXPECT_EQ(after.ray_center, before.ray_center);
  EXPECT_NE(after.ray_center, first.ray_center) << "it had to be aimed anew";
}

TEST_F(MapRecordTest, ACameraOfWhichAllIsLostButItsValuesIsTakenAsItIs) {
  use_prior(1.04);
  grow();
  MapRecord damaged = maker_->take_changes();
  ASSERT_EQ(damaged.calibrated_cameras.size(), 1U);
  damaged.calibrated_cameras.clear();
  const auto restored = restore(damaged);
  ASSERT_TRUE(restored);
  const auto cameras = restored->maker->statistics().cameras;
  ASSERT_EQ(cameras.size(), 1U) << "it keeps its place: others are counted from it";
  EXPECT_TRUE(cameras[0].frozen);
  EXPECT_EQ(cameras[0].camera->parameters(), maker_->statistics().cameras.at(0).camera->parameters());
  EXPECT_EQ(restored->maker->statistics().keyframes, maker_->statistics().keyframes);
}

TEST_F(MapRecordTest, ACameraAfterALostOneStaysWhatItWas) {
  use_prior(1.02);
  start();
  const CameraPrior first = *input_.prior;
  input_.prior->version.client = ClientId{{2}};
  ASSERT_EQ(offer(5).verdict, KeyframeVerdict::kAccepted);
  MapRecord damaged = maker_->take_changes();
  ASSERT_EQ(damaged.calibrated_cameras.size(), 2U);
  drop_at(&damaged.calibrated_cameras, 0);
  auto restored = restore(damaged);
  ASSERT_TRUE(restored);
  const auto cameras = restored->maker->statistics().cameras;
  ASSERT_EQ(cameras.size(), 2U);
  EXPECT_TRUE(cameras[0].frozen);
  EXPECT_EQ(cameras[1].version.client, input_.prior->version.client);
  // What is written of it from now on does not go where the lost one was.
  MapRecord kept = damaged;
  apply(restored->maker->take_changes(), &kept);
  restored = restore(kept);
  ASSERT_TRUE(restored);
  EXPECT_EQ(restored->maker->statistics().cameras.at(1).version.client, input_.prior->version.client);
  EXPECT_NE(restored->maker->statistics().cameras.at(0).version.client, input_.prior->version.client);
  EXPECT_NE(first.version.client, input_.prior->version.client);
}

TEST_F(MapRecordTest, ChangesInOrderMakeTheWhole) {
  start();
  MapRecord kept = maker_->take_changes();
  for (int step = 5; step <= 14; step += 3) {
    ASSERT_EQ(offer(step).verdict, KeyframeVerdict::kAccepted);
    apply(maker_->take_changes(), &kept);
  }
  adjust_globally();
  const MapRecord last = maker_->take_changes();
  EXPECT_THAT(last.sources, IsEmpty()) << "an adjustment makes no points";
  EXPECT_THAT(last.images, IsEmpty());
  EXPECT_FALSE(last.foundation);
  EXPECT_FALSE(last.positions.empty());
  apply(last, &kept);
  EXPECT_TRUE(maker_->take_changes().empty()) << "nothing has changed";

  maker_->keep_everything_anew();
  const MapRecord whole = maker_->take_changes();
  EXPECT_EQ(whole.keyframes.size(), kept.keyframes.size());
  const auto from_changes = restore(kept);
  const auto from_whole = restore(whole);
  ASSERT_TRUE(from_changes && from_whole);
  EXPECT_TRUE(bytes_of(*from_changes->maker->snapshot()) == bytes_of(*from_whole->maker->snapshot()));
  EXPECT_EQ(from_whole->maker->statistics().measurements, maker_->statistics().measurements);
  EXPECT_DOUBLE_EQ(from_whole->maker->reprojection_rms(), maker_->reprojection_rms());
}

TEST_F(MapRecordTest, ImagesThatWereEvictedAndPagedInChangeNothing) {
  start();
  MapRecord kept = maker_->take_changes();
  const auto other = restore(kept);
  ASSERT_TRUE(other);
  other->maker->keep_everything_anew();  // its images have not been given yet
  other->maker->evict_images();
  EXPECT_THAT(other->maker->lacking_images(), IsEmpty());

  for (int step = 5; step <= 11; step += 3) {
    apply(maker_->take_changes(), &kept);
    maker_->evict_images();
    EXPECT_EQ(maker_->statistics().without_images, maker_->statistics().keyframes);
    EXPECT_GT(maker_->statistics().evicted_bytes, 0U);
    EXPECT_TRUE(maker_->take_changes().empty()) << "that is no change";
    const KeyframeInput next = testing::make_offer(scene_, *maker_->snapshot(), step);
    ASSERT_EQ(maker_->add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    EXPECT_EQ(maker_->statistics().without_images + 1, maker_->statistics().keyframes);
    maker_->keep_everything_anew();
    const MapRecord whole = maker_->take_changes();
    EXPECT_EQ(whole.images.size(), 1U) << "the others are kept";
    EXPECT_THAT(whole.removed_images, IsEmpty());
    apply(whole, &kept);
    for (const KeyframeId id : maker_->lacking_images()) {
      EXPECT_FALSE(maker_->page_in_image(id, GrayImage(8, 8).view()));
      const auto image = std::find_if(kept.images.begin(), kept.images.end(),
                                      [id](const auto& i) { return i.keyframe == id; });
      ASSERT_NE(image, kept.images.end());
      EXPECT_TRUE(maker_->page_in_image(id, image->image->view()));
    }
    ASSERT_EQ(other->maker->add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    for (MapMaker* maker : {maker_.get(), other->maker.get()}) {
      while (maker->step(kNeverYield).work != MapWork::kNone) {
      }
      EXPECT_TRUE(maker->has_work()) << "a global adjustment";
      const GlobalAdjustmentPtr problem = maker->prepare_global_adjustment();
      solve(problem.get(), {});
      maker->adopt(*problem);
    }
    apply(maker_->take_changes(), &kept);
    MapRecord all;
    other->maker->keep_everything_anew();
    apply(other->maker->take_changes(), &all);
    const auto a = restore(kept);
    const auto b = restore(all);
    ASSERT_TRUE(a && b);
    EXPECT_THAT(a->repairs, IsEmpty());
    EXPECT_TRUE(bytes_of(*a->maker->snapshot()) == bytes_of(*b->maker->snapshot()));
    EXPECT_EQ(a->maker->statistics().bytes, b->maker->statistics().bytes);
  }
}

TEST_F(MapRecordTest, WhatIsLostIsNamedAndTheRestGoesOn) {
  grow();
  const MapRecord whole = maker_->take_changes();
  struct Loss {
    const char* said;
    std::function<void(MapRecord*)> lose;
  };
  const Loss losses[] = {
      {"keyframe 3 is left out: its image is lost", [](MapRecord* r) { drop_at(&r->images, 2); }},
      {"keyframe 3 is left out: its measurements are lost",
       [](MapRecord* r) { drop_at(&r->measurements, 2); }},
      {"keyframe 4 is left out: its entry is lost", [](MapRecord* r) { drop_at(&r->keyframes, 3); }},
      {"64 points are left out", [](MapRecord* r) { drop_at(&r->positions, 1); }},
      {"64 points are left out", [](MapRecord* r) { drop_at(&r->sources, 1); }},
  };
  for (const Loss& loss : losses) {
    SCOPED_TRACE(loss.said);
    MapRecord record = whole;
    loss.lose(&record);
    const auto restored = restore(record);
    ASSERT_TRUE(restored) << restored.error().message;
    ASSERT_FALSE(restored->repairs.empty());
    EXPECT_THAT(restored->repairs.front() + restored->repairs.back(), HasSubstr(loss.said));
    MapMaker& map = *restored->maker;
    EXPECT_LT(map.statistics().measurements, maker_->statistics().measurements);
    const KeyframeInput next = testing::make_offer(scene_, *map.snapshot(), 17);
    EXPECT_EQ(map.add_keyframe(next).verdict, KeyframeVerdict::kAccepted);
    while (map.step(kNeverYield).work != MapWork::kNone) {
    }
    EXPECT_LT(map.reprojection_rms(), 0.6);
  }
}

TEST_F(MapRecordTest, WhatIsNoMapIsRefused) {
  start();
  const MapRecord whole = maker_->take_changes();
  MapRecord record = whole;
  record.foundation.reset();
  EXPECT_EQ(restore(record).error().code, ErrorCode::kDamaged);
  record = whole;
  drop_at(&record.images, 0);
  EXPECT_THAT(restore(record).error().message, HasSubstr("first keyframe"));
  record = whole;
  drop_at(&record.images, 1);
  EXPECT_EQ(restore(record).error().code, ErrorCode::kDamaged);
  EXPECT_EQ(restore(MapRecord{}).error().code, ErrorCode::kDamaged);
}

TEST_F(MapRecordTest, AKeyframeThatLacksPointsIsHeldToItsExtentByWhoGoesOn) {
  start();
  const auto before = maker_->snapshot();
  KeyframeInput offered = testing::make_offer(scene_, *before, 5);
  const SE3 pose = offered.camera_from_reference * before->find(offered.reference)->camera_from_map;
  const MapStatistics all = maker_->statistics();
  const double middle = 0.5 * (all.bounds_min.x() + all.bounds_max.x());
  const Box left{{-100, -100, -100}, {std::max(middle, pose.center().x() + 0.01), 100, 100}};
  offered.extent = left;
  ASSERT_EQ(maker_->add_keyframe(offered).verdict, KeyframeVerdict::kAccepted);
  const auto restored = restore(maker_->take_changes());
  ASSERT_TRUE(restored) << restored.error().message;
  while (restored->maker->step(kNeverYield).work != MapWork::kNone) {
  }
  const auto after = restored->maker->snapshot();
  size_t made = 0;
  const PointId last = before->point_blocks.back()->patches->points.back().id;
  for (const auto& block : after->point_blocks) {
    for (int slot = 0; slot < block->count; ++slot) {
      const PointId id = block->source(slot).id;
      if (id <= last || !after->find(id)) continue;
      ++made;
      EXPECT_TRUE(contains(left, block->position(slot)));
    }
  }
  EXPECT_GT(made, 0U) << "it makes points still";
}

TEST_F(MapRecordTest, ReferencesThatLeadNowhereAreLeftOut) {
  grow();
  MapRecord record = maker_->take_changes();
  record.measurements[2].measurements.front().point = PointId{record.point_count + 7};
  record.measurements[2].measurements.back().level = 9;
  record.sources[0].points[0].keyframe = KeyframeId{99};
  record.positions[0].points[1].position.x() = std::nan("");
  record.keyframes[3].reference = KeyframeId{4};  // itself
  record.work->newest = KeyframeId{1000};
  record.work->wanting_observers = {PointId{0}, PointId{record.point_count + 1}};
  record.work->wanting_points = {{KeyframeId{50}, 99, 12345, -3}, {KeyframeId{2}, 99, 12345, -3}};
  const auto restored = restore(record);
  ASSERT_TRUE(restored) << restored.error().message;
  EXPECT_FALSE(restored->repairs.empty());
  while (restored->maker->step(kNeverYield).work != MapWork::kNone) {
  }
  EXPECT_LT(restored->maker->reprojection_rms(), 0.6);
}

}  // namespace
}  // namespace cairn
