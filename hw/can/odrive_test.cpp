// SPDX-License-Identifier: Apache-2.0
#include "hw/can/odrive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "hw/can/payload.h"

namespace cairn::odrive {
namespace {

using ::testing::HasSubstr;

constexpr std::array<Node, 2> kNodes = {{{16}, {17}}};

CanFrame encoded(Node node, const Message& message) {
  const auto frame = encode(node, message);
  EXPECT_TRUE(frame) << (frame ? "" : frame.error().message);
  return frame.value_or(CanFrame());
}

const std::array<Message, 10> kMessages = {Heartbeat{kErrorEstopRequested, AxisState::kClosedLoop, 1, true},
                                           Errors{kErrorWatchdogExpired, 7},
                                           EncoderEstimates{0.25F, -1.5F},
                                           Estop{},
                                           SetAxisState{AxisState::kHoming},
                                           SetControllerMode{ControlMode::kPosition, InputMode::kTrapezoid},
                                           SetInputPosition{-0.125F, 0.5F, -0.25F},
                                           SetLimits{2, 5},
                                           Request::kEncoderEstimates,
                                           ClearErrors{true}};

TEST(Odrive, TheFramesAreThoseOfTheManual) {
  EXPECT_EQ(to_string(encoded({16}, kMessages[0])), "201#0000000208010100");
  EXPECT_EQ(to_string(encoded({17}, kMessages[1])), "223#0000000107000000");
  EXPECT_EQ(to_string(encoded({16}, kMessages[2])), "209#0000803E0000C0BF");
  EXPECT_EQ(to_string(encoded({17}, kMessages[3])), "222#");
  EXPECT_EQ(to_string(encoded({16}, kMessages[4])), "207#0B000000");
  EXPECT_EQ(to_string(encoded({16}, kMessages[5])), "20B#0300000005000000");
  EXPECT_EQ(to_string(encoded({16}, kMessages[6])), "20C#000000BEF40106FF");
  EXPECT_EQ(to_string(encoded({16}, kMessages[7])), "20F#000000400000A040");
  EXPECT_EQ(to_string(encoded({16}, kMessages[8])), "209#R8");
  EXPECT_EQ(to_string(encoded({17}, kMessages[9])), "238#01");
}

TEST(Odrive, WhatIsEncodedIsDecodedToTheSame) {
  for (const Message& message : kMessages) {
    const CanFrame frame = encoded({17}, message);
    const auto decoded = decode(frame, kNodes);
    ASSERT_TRUE(decoded) << to_string(frame);
    EXPECT_EQ(*decoded, (Addressed{{17}, message})) << to_string(frame);
  }
}

CodecFault fault_of(const CanFrame& frame) {
  const auto decoded = decode(frame, kNodes);
  EXPECT_FALSE(decoded) << to_string(frame);
  return decoded ? CodecFault() : decoded.error();
}

TEST(Odrive, AnyOtherLengthIsAFaultThatSaysBoth) {
  for (const Message& message : kMessages) {
    CanFrame frame = encoded({16}, message);
    if (frame.remote) continue;
    const uint8_t right = frame.length;
    for (frame.length = 0; frame.length <= kMaxClassicPayload; ++frame.length) {
      if (frame.length == right) continue;
      EXPECT_EQ(fault_of(frame), (CodecFault{CodecFault::Kind::kWrongLength, frame.id, frame.length, right}));
    }
  }
  EXPECT_THAT(describe(fault_of({.id = {0x201, false}, .length = 7}), "ODrive"),
              HasSubstr("frame 201: 7 bytes, not the 8 of this message of ODrive"));
}

TEST(Odrive, EveryIdentifierIsAMessageOrANamedFault) {
  size_t messages = 0;
  for (uint32_t id = 0; id < 0x800; ++id) {
    for (uint8_t length = 0; length <= kMaxClassicPayload; ++length) {
      const CanFrame frame{.id = {id, false}, .length = length};
      const auto decoded = decode(frame, kNodes);
      const bool of_rig = id >> 5 == 16 || id >> 5 == 17;
      if (decoded) {
        ++messages;
        EXPECT_TRUE(of_rig);
      } else {
        EXPECT_EQ(decoded.error().kind == CodecFault::Kind::kUnknownNode, !of_rig) << to_string(frame);
      }
    }
  }
  EXPECT_EQ(messages, 2U * 9U);
  EXPECT_EQ(fault_of({.id = {0x21F, false}, .length = 8}).kind, CodecFault::Kind::kUnknownId);
}

TEST(Odrive, KindsOfFramesThatTheProtocolHasNotAreFaults) {
  EXPECT_EQ(fault_of({.id = {0x201, true}, .length = 8}).kind, CodecFault::Kind::kWrongKind);
  EXPECT_EQ(fault_of({.id = {0x201, false}, .fd = true, .length = 8}).kind, CodecFault::Kind::kWrongKind);
  EXPECT_EQ(fault_of({.id = {0x202, false}, .remote = true}).kind, CodecFault::Kind::kWrongKind);
}

TEST(Odrive, NumbersThatAreNotFiniteAreNeitherSentNorTaken) {
  for (const float bad : {std::nanf(""), std::numeric_limits<float>::infinity()}) {
    for (const Message& message :
         {Message(EncoderEstimates{bad, 0}), Message(EncoderEstimates{0, bad}),
          Message(SetInputPosition{bad, 0, 0}), Message(SetLimits{bad, 1}), Message(SetLimits{1, bad}),
          Message(SetInputPosition{0, bad, 0}), Message(SetInputPosition{0, 0, bad})}) {
      EXPECT_FALSE(encode({16}, message));
    }
  }
  for (const uint32_t id : {0x209U, 0x20CU, 0x20FU}) {
    const CanFrame frame{.id = {id, false}, .length = 8, .data = {0, 0, 0xC0, 0x7F}};
    EXPECT_EQ(fault_of(frame).kind, CodecFault::Kind::kNotFinite) << to_string(frame);
  }
}

TEST(Odrive, EachStepOfAFeedforwardIsReadAndWritten) {
  for (int steps = std::numeric_limits<int16_t>::min(); steps <= std::numeric_limits<int16_t>::max();
       ++steps) {
    CanFrame frame = encoded({16}, SetInputPosition{});
    put_number(static_cast<int16_t>(steps), std::span(frame.data), 4, std::endian::little);
    const auto decoded = decode(frame, kNodes);
    ASSERT_TRUE(decoded) << steps;
    ASSERT_EQ(to_string(encoded({16}, decoded->message)), to_string(frame)) << steps;
  }
}

TEST(Odrive, WhatAFieldDoesNotHoldIsRefused) {
  EXPECT_TRUE(encode({16}, SetInputPosition{0, 32.767F, -32.768F}));
  for (const Message& message :
       {Message(SetInputPosition{0, 32.768F, 0}), Message(SetInputPosition{0, 0, -1e9F}),
        Message(Heartbeat{0, static_cast<AxisState>(256), 0, false})}) {
    const auto frame = encode({16}, message);
    ASSERT_FALSE(frame);
    EXPECT_EQ(frame.error().code, ErrorCode::kUsage);
  }
  EXPECT_THAT(encode({64}, Estop{}).error().message, HasSubstr("ODrive node 64: nodes are 0 to 63"));
  EXPECT_TRUE(encode({63}, Estop{}));
  // A state beyond a byte is not taken for the one that its low byte names.
  const auto decoded = decode({.id = {0x207, false}, .length = 4, .data = {8, 1}}, kNodes);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(std::get<SetAxisState>(decoded->message).state, static_cast<AxisState>(264));
}

TEST(Odrive, TheFilterOfANodePassesItsFramesOnly) {
  for (uint32_t id = 0; id < 0x800; ++id) {
    EXPECT_EQ(matches(filter_of({17}), {.id = {id, false}}), id >> 5 == 17);
  }
}

}  // namespace
}  // namespace cairn::odrive
