// SPDX-License-Identifier: Apache-2.0
#include "common/image/descriptor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <random>
#include <utility>
#include <vector>

#include "common/image/kernels.h"
#include "common/image/place.h"
#include "common/image/test_textures.h"

namespace cairn {
namespace {

using test::TightImage;

constexpr unsigned kSeed = 4;

std::vector<Descriptor> random_descriptors(size_t count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::vector<Descriptor> made(count);
  for (Descriptor& d : made) {
    for (uint64_t& word : d) word = random();
  }
  return made;
}

/// A texture of blobs, sampled anywhere.
const test::Waves<2>& texture() {
  static const test::Waves<2> waves(kSeed, 0.7, 14);
  return waves;
}

Descriptor describe_center(const GrayImage& image) {
  GrayImage smoothed;
  smooth_for_descriptors(image, &smoothed);
  Descriptor descriptor{};
  EXPECT_TRUE(describe(smoothed,
                       {static_cast<int16_t>(image.width() / 2), static_cast<int16_t>(image.height() / 2)},
                       &descriptor));
  return descriptor;
}

/// 41x41 around a place of the texture, rolled and lit.
GrayImage view_of(const Eigen::Vector2d& place, double roll, double gain = 1, double bias = 0) {
  return test::render(41, 41, [&](int x, int y) {
    const Eigen::Vector2d p = place + Eigen::Rotation2Dd(roll) * Eigen::Vector2d(x - 20, y - 20);
    return std::clamp(gain * texture()(p) + bias, 0.0, 255.0);
  });
}

TEST(Descriptor, DistanceCountsDifferentBits) {
  const auto d = random_descriptors(20, kSeed);
  for (const Descriptor& a : d) {
    EXPECT_EQ(descriptor_distance(a, a), 0);
    for (const Descriptor& b : d) {
      int bits = 0;
      for (size_t i = 0; i < 256; ++i) bits += ((a[i / 64] ^ b[i / 64]) >> (i % 64) & 1) != 0 ? 1 : 0;
      EXPECT_EQ(descriptor_distance(a, b), bits);
    }
  }
}

bool is_same(const NearDescriptor& a, const NearDescriptor& b) {
  return a.index == b.index && a.distance == b.distance;
}

/// What find_nearest_few() is asked for.
struct FewTest : ::testing::TestWithParam<Simd> {
  static constexpr float kRatio = 0.9F;
  const std::vector<Descriptor> set = random_descriptors(300, kSeed);
  const std::array<IndexRange, 3> ranges{IndexRange{20, 100}, {120, 120}, {110, 290}};

  [[nodiscard]] std::vector<NearDescriptor> all_within(const Descriptor& query, int limit) const {
    std::vector<NearDescriptor> near;
    for (const IndexRange& range : ranges) {
      for (uint32_t i = range.begin; i < range.end; ++i) {
        const int distance = descriptor_distance(query, set[i]);
        if (distance <= limit) near.push_back({i, distance});
      }
    }
    return near;
  }
  void find(const Descriptor& query, int limit, std::vector<NearDescriptor>* out) const {
    kernels::find_nearest_few(query, set, ranges, limit, kRatio, out, GetParam());
  }
};

TEST_P(FewTest, TheNearestAndWhatIsAboutAsNearIsFound) {
  constexpr int kLimit = 105;
  size_t several = 0;
  size_t left_out = 0;
  for (const Descriptor& query : random_descriptors(30, kSeed + 1)) {
    std::vector<NearDescriptor> expected = all_within(query, 256);
    const int least = std::ranges::min(expected, {}, &NearDescriptor::distance).distance;
    const int farthest = least <= kLimit ? farthest_within_ratio(least, kRatio) : -1;
    std::erase_if(expected, [&](const NearDescriptor& n) { return n.distance > farthest; });
    std::vector<NearDescriptor> found;
    find(query, kLimit, &found);
    EXPECT_TRUE(std::ranges::equal(found, expected, is_same)) << "the nearest is " << least << " away";
    several += expected.size() > 1 ? 1 : 0;
    left_out += expected.empty() ? 1 : 0;
  }
  EXPECT_GT(several, 0U);
  EXPECT_GT(left_out, 0U);
}

TEST_P(FewTest, WhatIsFoundIsAppended) {
  const Descriptor query = set[150];
  std::vector<NearDescriptor> found{{7, 300}};
  find(query, 0, &found);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(std::pair(found[0].index, found[0].distance), std::pair(7U, 300)) << "it was there before";
  EXPECT_EQ(std::pair(found[1].index, found[1].distance), std::pair(150U, 0));
}

TEST_P(FewTest, WhereNothingIsNearNothingIsFound) {
  constexpr int kLimit = 60;
  const Descriptor query = random_descriptors(1, kSeed + 1)[0];
  ASSERT_TRUE(all_within(query, kLimit).empty());
  std::vector<NearDescriptor> found{{7, 300}};
  find(query, kLimit, &found);
  EXPECT_EQ(found.size(), 1U);
}

INSTANTIATE_TEST_SUITE_P(Descriptor, FewTest, ::testing::ValuesIn(test::simd_variants()));

TEST(Descriptor, TheNearestFewOfTheBestVariantAreThoseOfTheReference) {
  const auto set = random_descriptors(300, kSeed);
  const std::array ranges{IndexRange{0, 300}};
  for (const Descriptor& query : random_descriptors(30, kSeed + 1)) {
    std::vector<NearDescriptor> found;
    std::vector<NearDescriptor> expected;
    find_nearest_few(query, set, ranges, 115, 0.9F, &found);
    kernels::find_nearest_few(query, set, ranges, 115, 0.9F, &expected, Simd::kScalar);
    EXPECT_TRUE(std::ranges::equal(found, expected, is_same));
  }
}

TEST(Descriptor, TheNearestIsFoundWithTheSecond) {
  const auto set = random_descriptors(300, kSeed);
  for (const Descriptor& query : random_descriptors(30, kSeed + 1)) {
    std::vector<int> distances;
    for (const Descriptor& d : set) distances.push_back(descriptor_distance(query, d));
    const NearestDescriptor found = find_nearest(query, set);
    const auto least = std::min_element(distances.begin(), distances.end());
    EXPECT_EQ(found.index, least - distances.begin());
    EXPECT_EQ(found.distance, *least);
    std::sort(distances.begin(), distances.end());
    EXPECT_EQ(found.second_distance, distances[1]);
  }
  EXPECT_EQ(find_nearest(set[0], {}).index, -1);
}

TEST(Descriptor, LightAndRollChangeLittleAndAnotherPlaceMuch) {
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> anywhere(-500, 500);
  std::uniform_real_distribution<double> any_roll(-3, 3);
  int light = 0;
  int roll = 0;
  int elsewhere = 0;
  constexpr int kPlaces = 40;
  for (int i = 0; i < kPlaces; ++i) {
    const Eigen::Vector2d place(anywhere(random), anywhere(random));
    const Descriptor here = describe_center(view_of(place, 0));
    light += descriptor_distance(here, describe_center(view_of(place, 0, 0.5, 40)));
    roll += descriptor_distance(here, describe_center(view_of(place, any_roll(random))));
    elsewhere += descriptor_distance(here, describe_center(view_of({anywhere(random), anywhere(random)}, 0)));
  }
  EXPECT_LT(light / kPlaces, 10);
  EXPECT_LT(roll / kPlaces, 50);
  EXPECT_GT(elsewhere / kPlaces, 100);
}

uint64_t hash_of_descriptors() {
  constexpr int kSide = 432;
  GrayImage smoothed;
  smooth_for_descriptors(test::integer_image(kSide, kSide).view(), &smoothed);
  test::Hash hash;
  for (int16_t y = kDescriptorRadius; y < kSide - kDescriptorRadius; y += 7) {
    for (int16_t x = kDescriptorRadius; x < kSide - kDescriptorRadius; x += 7) {
      Descriptor descriptor{};
      EXPECT_TRUE(describe(smoothed, {x, y}, &descriptor));
      hash.add(descriptor);
    }
  }
  return hash.value;
}

TEST(Descriptor, IsOnEveryMachineWhatMapsAndPeersHave) {
  EXPECT_EQ(hash_of_descriptors(), 0xFB6CB8E02514B20CULL);
}

TEST(Descriptor, NothingOutsideTheImageIsRead) {
  std::mt19937 random(kSeed);
  const TightImage image = TightImage::noise(40, 30, 40, &random);
  Descriptor descriptor;
  for (int y = -2; y < 32; ++y) {
    for (int x = -2; x < 42; ++x) {
      const bool inside = x >= kDescriptorRadius && y >= kDescriptorRadius && x < 40 - kDescriptorRadius &&
                          y < 30 - kDescriptorRadius;
      EXPECT_EQ(describe(image.view(), {static_cast<int16_t>(x), static_cast<int16_t>(y)}, &descriptor),
                inside);
    }
  }
  for (const int size : {1, 2, 3, 5}) {
    GrayImage smoothed;
    smooth_for_descriptors(TightImage::noise(size, size, 40, &random).view(), &smoothed);
    EXPECT_EQ(smoothed.width(), size);
  }
}

TEST(Descriptor, SmoothingKeepsAFlatImageAndTheMeanOfAnother) {
  GrayImage smoothed;
  smooth_for_descriptors(test::render(20, 10, [](int, int) { return 137; }), &smoothed);
  for (int y = 0; y < 10; ++y) {
    for (int x = 0; x < 20; ++x) EXPECT_EQ(smoothed.view().at(x, y), 137);
  }
  smooth_for_descriptors(test::render(21, 21, [](int x, int y) { return x == 10 && y == 10 ? 255 : 0; }),
                         &smoothed);
  int sum = 0;
  for (int y = 0; y < 21; ++y) {
    for (int x = 0; x < 21; ++x) {
      sum += smoothed.view().at(x, y);
      EXPECT_EQ(smoothed.view().at(x, y), smoothed.view().at(20 - x, y)) << "symmetric";
      EXPECT_EQ(smoothed.view().at(x, y), smoothed.view().at(y, x));
    }
  }
  EXPECT_NEAR(sum, 255, 40) << "but for rounding";
}

TEST(Place, CornersAreSpreadBoundedAndInTheImage) {
  const GrayImage image = test::render(320, 240, [](int x, int y) {
    return x < 160 ? std::clamp(128 + 3 * (texture()({3.0 * x, 3.0 * y}) - 128), 0.0, 255.0)
                   : 128.0 + (x / 40 + y / 40) % 2 * 40;
  });
  Pyramid pyramid;
  pyramid.build(image);
  std::array<CornerList, kPyramidLevels> corners;
  for (int l = 0; l < kPyramidLevels; ++l)
    detect_fast10(pyramid.level(l), 10, &corners[static_cast<size_t>(l)]);
  const PlaceView view = describe_place(pyramid, corners);
  EXPECT_EQ(view.small.width(), 40);
  std::array<int, kPyramidLevels> count{};
  for (const PlaceCorner& c : view.corners) {
    ++count[c.level];
    EXPECT_TRUE(image.view().contains(c.pixel.x(), c.pixel.y()));
  }
  for (size_t l = 0; l < count.size(); ++l) EXPECT_LE(count[l], kPlaceCorners[l]);
  EXPECT_GT(count[0], 50);
}

TEST(Place, WhatAHigherGainBringsOutDoesNotDriveOutWhatIsStrong) {
  // Rich on the left; on the right, weak spots that are corners at twice the gain only.
  const auto grey = [](int x, int y) {
    if (x < 160) return std::clamp(60 + 0.5 * (texture()({3.0 * x, 3.0 * y}) - 128), 0.0, 127.0);
    return 60.0 + (x % 9 < 2 && y % 9 < 2 ? 8 : 0);
  };
  const auto corners_at = [&](double gain) {
    Pyramid pyramid;
    pyramid.build(test::render(320, 240, [&](int x, int y) { return gain * std::round(grey(x, y)); }));
    std::array<CornerList, kPyramidLevels> corners;
    detect_fast10(pyramid.level(0), 10, corners.data());
    for (size_t l = 1; l < corners.size(); ++l)
      detect_fast10(pyramid.level(static_cast<int>(l)), 255, &corners[l]);
    std::vector<std::pair<float, float>> pixels;
    for (const PlaceCorner& c : describe_place(pyramid, corners).corners)
      pixels.emplace_back(c.pixel.x(), c.pixel.y());
    std::sort(pixels.begin(), pixels.end());
    return pixels;
  };
  const auto once = corners_at(1);
  const auto twice = corners_at(2);
  ASSERT_GT(once.size(), 300U);
  ASSERT_GT(twice.size(), 400U);
  std::vector<std::pair<float, float>> kept;
  std::set_intersection(once.begin(), once.end(), twice.begin(), twice.end(), std::back_inserter(kept));
  EXPECT_GT(kept.size(), once.size() * 9 / 10);
}

}  // namespace
}  // namespace cairn
