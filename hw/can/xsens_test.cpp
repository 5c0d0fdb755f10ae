// SPDX-License-Identifier: Apache-2.0
#include "hw/can/xsens.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace cairn::xsens {
namespace {

using ::testing::HasSubstr;

CanFrame encoded(const Message& message, const Ids& ids = {}) {
  const auto frame = encode(message, ids);
  EXPECT_TRUE(frame);
  return frame.value_or(CanFrame());
}

const std::array<Message, 7> kMessages = {SampleTime{0x01020304},
                                          GroupCounter{0x0506},
                                          StatusWord{0x80000001},
                                          Quaternion{.x = -1, .y = 0, .z = 0, .w = 0},
                                          Euler{std::numbers::pi / 2, -std::numbers::pi / 4, 0},
                                          RateOfTurn{{1, -0.5, 0.25}},
                                          Acceleration{{0, -1, 9.8125}}};

// Big-endian, as inferred (kByteOrder).
TEST(Xsens, TheFramesAreThoseOfTheManual) {
  EXPECT_EQ(to_string(encoded(kMessages[0])), "005#01020304");
  EXPECT_EQ(to_string(encoded(kMessages[1])), "006#0506");
  EXPECT_EQ(to_string(encoded(kMessages[2])), "011#80000001");
  EXPECT_EQ(to_string(encoded(kMessages[3])), "021#0000800100000000");
  EXPECT_EQ(to_string(encoded(kMessages[4])), "022#2D00E9800000");
  EXPECT_EQ(to_string(encoded(kMessages[5])), "032#0200FF000080");
  EXPECT_EQ(to_string(encoded(kMessages[6])), "034#0000FF0009D0");
}

TEST(Xsens, WhatItsStepsHoldIsDecodedToTheSame) {
  for (const Message& message : kMessages) {
    const CanFrame frame = encoded(message);
    const auto decoded = decode(frame);
    ASSERT_TRUE(decoded) << to_string(frame);
    EXPECT_EQ(*decoded, message) << to_string(frame);
  }
}

TEST(Xsens, ValuesAreRoundedToTheNearestStepAndSaturate) {
  const auto back = decode(encoded(RateOfTurn{{0.0012, -100, 100}}));
  ASSERT_TRUE(back);
  EXPECT_EQ(*back, Message(RateOfTurn{{1.0 / 512, -64, 32767.0 / 512}}));
  EXPECT_FALSE(encode(RateOfTurn{{0, std::nan(""), 0}}));
  EXPECT_FALSE(encode(Quaternion{.x = INFINITY}));
}

TEST(Xsens, EveryFrameIsAMessageOrANamedFault) {
  const auto kind_of = [](const CanFrame& frame) { return decode(frame).error().kind; };
  size_t messages = 0;
  for (uint32_t id = 0; id < 0x800; ++id) {
    for (uint8_t length = 0; length <= kMaxClassicPayload; ++length) {
      const CanFrame frame{.id = {id, false}, .length = length};
      if (decode(frame)) {
        ++messages;
        EXPECT_EQ(kind_of({.id = {id, true}, .length = length}), CodecFault::Kind::kWrongKind);
        EXPECT_EQ(kind_of({.id = {id, false}, .fd = true, .length = length}), CodecFault::Kind::kWrongKind);
        EXPECT_EQ(kind_of({.id = {id, false}, .remote = true, .length = length}),
                  CodecFault::Kind::kWrongKind);
      } else {
        EXPECT_THAT(kind_of(frame),
                    ::testing::AnyOf(CodecFault::Kind::kUnknownId, CodecFault::Kind::kWrongLength));
      }
    }
  }
  EXPECT_EQ(messages, kMessages.size());
  EXPECT_EQ(kind_of({.id = {0x076, false}, .length = 8}), CodecFault::Kind::kUnknownId);
  EXPECT_EQ(decode({.id = {0x032, false}, .length = 8}).error(),
            (CodecFault{CodecFault::Kind::kWrongLength, {0x032, false}, 8, 6}));
}

TEST(Xsens, IdentifiersAreThoseThatTheDeviceIsSetTo) {
  Ids ids;
  ids.rate_of_turn = 0x732;
  const CanFrame frame = encoded(kMessages[5], ids);
  EXPECT_EQ(frame.id.value, 0x732U);
  EXPECT_TRUE(decode(frame, ids));
  EXPECT_FALSE(decode(frame));
  size_t passed = 0;
  for (uint32_t id = 0; id < 0x800; ++id) passed += passes(filters_of(ids), {.id = {id, false}}) ? 1 : 0;
  EXPECT_EQ(passed, kMessages.size());
  EXPECT_TRUE(passes(filters_of(ids), frame));
}

TEST(Codec, EveryFaultIsDescribedWithWhatHelps) {
  const auto words = [](CodecFault::Kind kind) { return describe({kind, {0x21, false}, 3, 8}, "Xsens"); };
  EXPECT_THAT(words(CodecFault::Kind::kUnknownNode),
              HasSubstr("frame 021: of a node that the rig does not have"));
  EXPECT_THAT(words(CodecFault::Kind::kUnknownId), HasSubstr("do two devices share an identifier?"));
  EXPECT_THAT(words(CodecFault::Kind::kWrongLength),
              HasSubstr("3 bytes, not the 8 of this message of Xsens"));
  EXPECT_THAT(words(CodecFault::Kind::kWrongKind), HasSubstr("extended, CAN FD or remote"));
  EXPECT_THAT(words(CodecFault::Kind::kNotFinite), HasSubstr("not finite; is the device calibrated?"));
}

}  // namespace
}  // namespace cairn::xsens
