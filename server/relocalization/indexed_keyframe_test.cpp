// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/indexed_keyframe.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "server/relocalization/exact_map.h"
#include "server/relocalization/match.h"

namespace cairn {
namespace {

using testing::describe_image;
using testing::ExactMap;
using testing::Scene;

/// The image as a camera takes it at so many times the exposure.
GrayImage exposed(const GrayView& image, double times) {
  GrayImage lit(image);
  for (int y = 0; y < lit.height(); ++y) {
    std::transform(lit.row(y), lit.row(y) + lit.width(), lit.row(y), [&](uint8_t grey) {
      return static_cast<uint8_t>(std::min(255.0, times * static_cast<double>(grey)));
    });
  }
  return lit;
}

KeyframeView with_image(const KeyframeView& view, const GrayImage& image) {
  auto pyramid = std::make_shared<Pyramid>();
  pyramid->build(image);
  KeyframeView taken = view;
  taken.pyramid = std::move(pyramid);
  return taken;
}

class IndexedKeyframeTest : public ::testing::Test {
 protected:
  [[nodiscard]] const KeyframeView& view() const { return map_.views().front(); }
  /// What is nearest to white is a quarter of it; nothing is.
  [[nodiscard]] GrayImage dim() const { return exposed(view().pyramid->level(0), 0.25); }

  Scene scene_{11};
  ExactMap map_{scene_, 1, {0}};
};

TEST_F(IndexedKeyframeTest, OverexposedAKeyframeLooksAsTheCameraWouldHaveTakenIt) {
  const auto keyframe = index_keyframe(view());
  const auto lit = index_keyframe(with_image(view(), exposed(view().pyramid->level(0), kOverexposure)));
  ASSERT_TRUE(keyframe->overexposed);
  EXPECT_GT(keyframe->overexposed->white, keyframe->as_taken.white);
  EXPECT_EQ(keyframe->overexposed->white, lit->as_taken.white);
  EXPECT_EQ(keyframe->overexposed->descriptors, lit->as_taken.descriptors);
  EXPECT_NE(keyframe->overexposed->descriptors, keyframe->as_taken.descriptors);
}

TEST_F(IndexedKeyframeTest, WhatIsTooDarkToBeClippedIsDescribedOnce) {
  KeyframeView growing = with_image(view(), dim());
  growing.measurements.pop_back();
  const auto before = index_keyframe(growing);
  EXPECT_FALSE(before->overexposed);
  EXPECT_FALSE(index_keyframe(with_image(view(), dim()), before.get())->overexposed);
}

TEST_F(IndexedKeyframeTest, EachPointIsFoundAtEachExposure) {
  const auto keyframe = index_keyframe(view());
  for (const DescribedPoints* exposed : {&keyframe->as_taken, &*keyframe->overexposed}) {
    size_t described = 0;
    ASSERT_EQ(exposed->of_measured.size(), keyframe->measured.size());
    for (size_t i = 0; i < keyframe->measured.size(); ++i) {
      for (uint8_t d = 0; d < keyframe->sightings[i].descriptions; ++d, ++described) {
        const DescribedPoint& point = exposed->points[exposed->of_measured[i][d]];
        EXPECT_EQ(point.measured, i);
      }
    }
    EXPECT_EQ(described, exposed->points.size());
    EXPECT_GT(described, keyframe->measured.size());
  }
}

TEST_F(IndexedKeyframeTest, TheExposureIsThatOfWhichAboutAsMuchIsWhite) {
  const auto keyframe = index_keyframe(view());
  const float taken = keyframe->as_taken.white;
  const float over = keyframe->overexposed->white;
  const float middle = (taken + over) / 2;
  for (const float white : {0.0F, taken, middle - 1e-3F})
    EXPECT_EQ(&keyframe->exposed_as(white), &keyframe->as_taken) << white;
  for (const float white : {middle + 1e-3F, over, 1.0F})
    EXPECT_EQ(&keyframe->exposed_as(white), &*keyframe->overexposed) << white;
}

/// Indexed again and again while the map grows, it is what it would be if it were described at once.
TEST_F(IndexedKeyframeTest, WhatIsKnownIsTakenOverAsItIs) {
  const size_t all = view().measurements.size();
  ASSERT_GT(all, 100U);
  KeyframeView growing = view();
  const auto keep = [&](auto is_kept) {
    growing.measurements.clear();
    for (size_t i = 0; i < all; ++i) {
      if (is_kept(i)) growing.measurements.push_back(view().measurements[i]);
    }
  };
  keep([](size_t i) { return i % 2 == 0; });
  auto keyframe = index_keyframe(growing);
  const auto expect_as_if_new = [&] {
    keyframe = index_keyframe(growing, keyframe.get());
    const auto anew = index_keyframe(growing);
    EXPECT_EQ(keyframe->measured, anew->measured);
    EXPECT_EQ(keyframe->words, anew->words);
    for (const auto& [taken, expected] : {std::pair(&keyframe->as_taken, &anew->as_taken),
                                          std::pair(&*keyframe->overexposed, &*anew->overexposed)}) {
      EXPECT_EQ(taken->white, expected->white);
      EXPECT_EQ(taken->descriptors, expected->descriptors);
      EXPECT_EQ(taken->begin_of, expected->begin_of);
      EXPECT_EQ(taken->of_measured, expected->of_measured);
    }
  };
  keep([](size_t i) { return i % 7 != 3; });
  expect_as_if_new();
  keep([](size_t i) { return i % 7 != 3 || i < 25; });  // a few: smoothed around each
  expect_as_if_new();
  growing.measurements[40].pixel.x() += 9;
  expect_as_if_new();
}

TEST_F(IndexedKeyframeTest, OfAnotherImageNothingIsTakenOver) {
  const auto other = scene_.render(Scene::pose(5), 105);
  const auto before = index_keyframe(with_image(view(), GrayImage(other->view())));
  EXPECT_EQ(index_keyframe(view(), before.get())->as_taken.descriptors,
            index_keyframe(view())->as_taken.descriptors);
}

/// What this is for. At every exposure as many are matched as without the other description, or more.
TEST_F(IndexedKeyframeTest, OfAnOverexposedImageMoreCornersAreMatched) {
  const IndexedMapPtr both = map_.index();
  IndexedMap once(*both);
  auto keyframe = std::make_shared<IndexedKeyframe>(*both->keyframes[0]);
  keyframe->overexposed.reset();
  once.keyframes[0] = keyframe;
  const auto image = scene_.render(Scene::pose(1), 101);
  const auto count = [&](const IndexedMap& map, double times) {
    const PlaceView asked = describe_image(exposed(image->view(), times));
    return testing::match_all(asked, map, 0).size();
  };
  EXPECT_EQ(count(*both, 1), count(once, 1));
  EXPECT_GT(count(*both, 2), count(once, 2));
  EXPECT_GT(static_cast<double>(count(*both, 2.5)), 1.2 * static_cast<double>(count(once, 2.5)));
}

}  // namespace
}  // namespace cairn
