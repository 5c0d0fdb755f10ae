// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/light.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Light, AsRecordedChangesNothing) {
  const auto table = light_table({});
  for (size_t v = 0; v < 256; ++v) EXPECT_EQ(table[v], v);
  EXPECT_EQ(to_string(Light{}), "as recorded");
}

TEST(Light, IsClippedToWhatACameraGives) {
  EXPECT_EQ(light_table({.gain = 2})[127], 254);
  EXPECT_EQ(light_table({.gain = 2})[200], 255);
  EXPECT_EQ(light_table({.gain = 0.5})[200], 100);
  EXPECT_EQ(light_table({.bias = -40})[30], 0);
  EXPECT_EQ(light_table({.bias = 40})[30], 70);
  EXPECT_EQ(light_table({.bias = 40})[250], 255);
}

TEST(Light, GammaKeepsBlackAndWhiteAndItsReciprocalUndoesIt) {
  const auto darker = light_table({.gamma = 2});
  const auto brighter = light_table({.gamma = 0.5});
  EXPECT_EQ(darker[0], 0);
  EXPECT_EQ(darker[255], 255);
  EXPECT_LT(darker[128], 128);
  EXPECT_GT(brighter[128], 128);
  for (size_t v = 16; v < 256; ++v) EXPECT_NEAR(brighter[darker[v]], static_cast<double>(v), 8) << v;
}

TEST(Light, EachChangeComesAloneAndHasAName) {
  std::vector<std::string> names;
  for (const Light& light : lights_to_stand()) {
    EXPECT_LE((light.gain != 1) + (light.bias != 0) + (light.gamma != 1), 1);
    names.push_back(to_string(light));
  }
  EXPECT_EQ(names, (std::vector<std::string>{"as recorded", "gain 0.5", "gain 2", "bias -40", "bias +40",
                                             "gamma 0.5", "gamma 2"}));
}

TEST(Light, EveryPixelOfAnImageIsChanged) {
  GrayImage image(3, 2);
  for (int y = 0; y < 2; ++y) std::fill_n(image.row(y), 3, static_cast<uint8_t>(10 * (y + 1)));
  const GrayImage lit = relight(image, {.gain = 2});
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 3; ++x) EXPECT_EQ(lit.row(y)[x], 20 * (y + 1));
  }
}

}  // namespace
}  // namespace cairn
