// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>

#include "hw/can/can_bus.h"

// For tests of buses only.
namespace cairn::testing {

/// A frame of one byte.
inline CanFrame frame(uint32_t id, uint8_t byte = 0) {
  return {.id = {id, false}, .length = 1, .data = {byte}};
}

/// The time until which a test waits: longer than any test takes that works.
inline MonotonicTime soon() {
  return std::chrono::steady_clock::now() + std::chrono::seconds(20);
}

/// The next frame that `bus` receives is `expected`.
inline void expect_next(CanBus& bus, const CanFrame& expected) {
  const auto got = receive_until(bus, soon());
  ASSERT_TRUE(got) << to_string(expected) << " did not come; " << describe(bus.health(), "the bus");
  EXPECT_EQ(got->frame, expected) << to_string(got->frame) << " came";
}

}  // namespace cairn::testing
