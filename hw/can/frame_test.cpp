// SPDX-License-Identifier: Apache-2.0
#include "hw/can/frame.h"

#include <gtest/gtest.h>
#include <linux/can.h>

#include <random>

#include "hw/can/kernel_frame.h"
#include "hw/can/test_seed.h"

namespace cairn {
namespace {

CanFrame random_frame(std::mt19937& random) {
  const auto below = [&](unsigned n) { return std::uniform_int_distribution<unsigned>(0, n - 1)(random); };
  constexpr std::array<uint8_t, 16> kLengths = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
  CanFrame frame;
  frame.id.extended = below(2) == 1;
  frame.id.value = below(frame.id.extended ? 1U << 29 : 1U << 11);
  frame.fd = below(2) == 1;
  frame.remote = !frame.fd && below(4) == 0;
  frame.fast_data = frame.fd && below(2) == 1;
  frame.length = kLengths.at(below(frame.fd ? 16 : 9));
  for (size_t i = 0; i < frame.payload().size(); ++i) frame.data.at(i) = static_cast<uint8_t>(below(256));
  return frame;
}

TEST(CanFrame, OnTheWayThroughTheKernelsLayoutItStaysTheSame) {
  const uint32_t seed = testing::any_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int i = 0; i < 2000; ++i) {
    const CanFrame frame = random_frame(random);
    ASSERT_TRUE(is_valid(frame)) << to_string(frame);
    const auto back = from_kernel(to_kernel(frame));
    ASSERT_TRUE(std::holds_alternative<CanFrame>(back)) << to_string(frame);
    EXPECT_EQ(std::get<CanFrame>(back), frame) << to_string(frame);
  }
}

TEST(CanFrame, WhatNoBusCarriesIsInvalid) {
  EXPECT_TRUE(is_valid({.id = {0x7FF, false}, .length = 8}));
  EXPECT_FALSE(is_valid({.id = {0x800, false}}));
  EXPECT_TRUE(is_valid({.id = {0x1FFF'FFFF, true}}));
  EXPECT_FALSE(is_valid({.id = {0x2000'0000, true}}));
  EXPECT_FALSE(is_valid({.length = 9}));
  EXPECT_FALSE(is_valid({.fd = true, .length = 9}));
  EXPECT_TRUE(is_valid({.fd = true, .length = 12}));
  EXPECT_FALSE(is_valid({.fd = true, .length = 65}));
  EXPECT_FALSE(is_valid({.remote = true, .fd = true}));
  EXPECT_FALSE(is_valid({.fast_data = true}));
}

TEST(CanFrame, BytesThatAreNoFrameAreNone) {
  for (const size_t size : {size_t{0}, size_t{1}, size_t{15}, size_t{17}, size_t{71}}) {
    EXPECT_TRUE(std::holds_alternative<std::monostate>(from_kernel({{}, size}))) << size;
  }
  KernelFrame too_long{{}, CAN_MTU};
  too_long.frame.len = 200;
  EXPECT_TRUE(std::holds_alternative<std::monostate>(from_kernel(too_long)));
}

TEST(CanFrame, IsWrittenAsCandumpWritesIt) {
  EXPECT_EQ(to_string(CanFrame{.id = {0x41, false}, .length = 2, .data = {2, 0xAB}}), "041#02AB");
  EXPECT_EQ(to_string(CanFrame{.id = {0xCF029E2, true}, .remote = true, .length = 4}), "0CF029E2#R4");
  EXPECT_EQ(
      to_string(CanFrame{.id = {0x245, false}, .fd = true, .fast_data = true, .length = 1, .data = {9}}),
      "245##109");
}

TEST(CanFilter, ComparesTheBitsOfItsMaskAndKeepsElevenAndTwentyNineBitsApart) {
  const CanFilter node{{0x200, false}, 0x7E0};
  EXPECT_TRUE(matches(node, {.id = {0x21F, false}}));
  EXPECT_TRUE(matches(node, {.id = {0x209, false}, .remote = true}));
  EXPECT_FALSE(matches(node, {.id = {0x220, false}}));
  EXPECT_FALSE(matches(node, {.id = {0x200, true}}));
  const auto only = CanFilter::only({0x12345, true});
  EXPECT_TRUE(matches(only, {.id = {0x12345, true}}));
  EXPECT_FALSE(matches(only, {.id = {0x12344, true}}));
  EXPECT_TRUE(passes({}, {.id = {0x12344, true}}));
  EXPECT_TRUE(passes({node, only}, {.id = {0x12345, true}}));
  EXPECT_FALSE(passes({node, only}, {.id = {0x345, false}}));
}

}  // namespace
}  // namespace cairn
