// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "server/relocalization/exact_map.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

using testing::camera_of;
using testing::describe_image;
using testing::error_of;
using testing::ExactMap;
using testing::MappedScene;
using testing::pose_at;
using testing::Scene;

/// A nearly empty place, and a full one that is like it but for what is in it.
struct LookAlikes : ::testing::Test {
  static constexpr double kFewThings = 0.1;
  static constexpr double kAside = 20;  ///< [m]
  const Scene empty{11, 21, kFewThings};
  const Scene full{11, 22, 1};
  const Scene unmapped{11, 23, kFewThings};  ///< like both

  static MappedScene mapped(const Scene& scene, double aside = 0) {
    return {.scene = &scene, .steps = {2, 4, 6}, .advance = kAdvance, .aside = aside};
  }
  static SE3 asked_from(int step) { return pose_at(step, kAdvance); }
  static RelocalizationAnswer ask(const PlaceIndex& index, const Scene& scene, int step,
                                  const SearchScope& scope = {}) {
    const auto image = scene.render(asked_from(step), 200 + static_cast<uint64_t>(step));
    return relocalize(index, *scene.camera(), describe_image(image->view()), {}, scope);
  }
  /// Of the unmapped place the empty one explains all it has, and so does the full one in part: it is
  /// neither.
  [[nodiscard]] RelocalizationAnswer expect_neither(const PlaceIndex& alone, const PlaceIndex& both,
                                                    int step) const {
    EXPECT_EQ(ask(alone, unmapped, step).verdict, RelocalizationVerdict::kConfirmed)
        << "nothing tells that what is seen is common";
    RelocalizationAnswer neither = ask(both, unmapped, step);
    EXPECT_EQ(neither.verdict, RelocalizationVerdict::kNotKnown);
    return neither;
  }

 private:
  static constexpr double kAdvance = 0.3;
};

TEST_F(LookAlikes, WhatPlacesHaveInCommonSpeaksForNoneOfThem) {
  const ExactMap empty_map(1, {mapped(empty)});
  PlaceIndex alone;
  alone.put(empty_map.index());
  PlaceIndex both = alone;
  both.put(ExactMap(2, {mapped(full)}).index());
  for (const int step : {3, 5}) {
    SCOPED_TRACE(step);
    const RelocalizationAnswer neither = expect_neither(alone, both, step);
    EXPECT_NE(neither.reason.find("more than one place looks like this"), std::string::npos)
        << neither.reason;
    const RelocalizationAnswer right = ask(both, empty, step);
    ASSERT_EQ(right.verdict, RelocalizationVerdict::kConfirmed) << right.reason;
    EXPECT_EQ(right.candidates.front().map, empty_map.snapshot()->map);
  }
}

TEST_F(LookAlikes, AMapOutOfScopeIsNobodysRival) {
  const ExactMap empty_map(1, {mapped(empty)});
  PlaceIndex alone;
  alone.put(empty_map.index());
  PlaceIndex both = alone;
  both.put(ExactMap(2, {mapped(full)}).index());
  const SearchScope scope{.maps = MapSet({empty_map.snapshot()->map})};
  for (const int step : {3, 5}) {
    SCOPED_TRACE(step);
    EXPECT_EQ(ask(both, unmapped, step).verdict, RelocalizationVerdict::kNotKnown);
    const RelocalizationAnswer bounded = ask(both, unmapped, step, scope);
    const RelocalizationAnswer told = ask(alone, unmapped, step);
    ASSERT_EQ(bounded.verdict, RelocalizationVerdict::kConfirmed) << bounded.reason;
    ASSERT_EQ(bounded.candidates.size(), told.candidates.size()) << "as if the other were not there";
    EXPECT_EQ(bounded.candidates.front().keyframe, told.candidates.front().keyframe);
    EXPECT_EQ(bounded.candidates.front().inliers, told.candidates.front().inliers);
  }
}

TEST_F(LookAlikes, NorDoesItWhereTheyAreInOneMap) {
  const ExactMap one_map(1, {mapped(empty), mapped(full, kAside)});
  PlaceIndex alone;
  alone.put(ExactMap(1, {mapped(empty)}).index());
  PlaceIndex both;
  both.put(one_map.index());
  for (const int step : {3, 5}) {
    SCOPED_TRACE(step);
    const RelocalizationAnswer neither = expect_neither(alone, both, step);
    EXPECT_TRUE(neither.reason.find("more than one place looks like this") != std::string::npos ||
                neither.reason.find("agree with another pose in this map") != std::string::npos)
        << neither.reason;
    const RelocalizationAnswer right = ask(both, empty, step);
    ASSERT_EQ(right.verdict, RelocalizationVerdict::kConfirmed) << right.reason;
    EXPECT_LT(error_of(camera_of(right, *one_map.snapshot()), asked_from(step), *one_map.snapshot()), 0.01);
  }
}

TEST(Overlap, OfTwoMapsOfOnePlaceNeitherRefusesTheOther) {
  const Scene scene(11);
  PlaceIndex index;
  index.put(ExactMap(scene, 1, {0, 4, 8}).index());
  index.put(ExactMap(scene, 2, {2, 6, 10}).index());
  for (int step = 1; step < 10; step += 2) {
    const auto image = scene.render(Scene::pose(step), 300 + static_cast<uint64_t>(step));
    const RelocalizationAnswer answer =
        relocalize(index, *scene.camera(), describe_image(image->view()), RelocOptions());
    EXPECT_EQ(answer.verdict, RelocalizationVerdict::kConfirmed) << step << ": " << answer.reason;
  }
}

}  // namespace
}  // namespace cairn
