// SPDX-License-Identifier: Apache-2.0
#include "hw/can/late_bus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Opened = Result<std::unique_ptr<CanBus>>;

Opened is_missing() {
  return fail(ErrorCode::kNotFound, "can0: no such interface");
}

class LateBusTest : public ::testing::Test {
 protected:
  LateBus late(std::chrono::milliseconds patience = 10s) {
    return {patience, [this](const std::string& words) { told_.push_back(words); },
            [this](std::chrono::milliseconds step) {
              waited_ += step;
              ++looks_;
              return gives_up_;
            }};
  }
  std::vector<std::string> told_;
  std::chrono::milliseconds waited_{0};
  int looks_ = 0;
  bool gives_up_ = false;
};

TEST_F(LateBusTest, AnInterfaceThatComesIsOpenedAndItWasSaidOnceThatItIsWaitedFor) {
  const Opened bus = open_late_can_bus(late(), [this]() -> Opened {
    if (waited_ < 3s) return is_missing();
    return std::move(make_bus_pair()->first);
  });
  EXPECT_TRUE(bus);
  EXPECT_GE(waited_, 3s);
  EXPECT_LE(waited_, 4s) << "looked at once a second at least";
  EXPECT_THAT(told_, ElementsAre(HasSubstr("can0: no such interface. It is waited for, 10 s")));
}

TEST_F(LateBusTest, OneThatDoesNotComeIsNamedAfterTheTime) {
  const Opened bus = open_late_can_bus(late(), is_missing);
  ASSERT_FALSE(bus);
  EXPECT_EQ(bus.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(waited_, 10s);
  EXPECT_LE(looks_, 16) << "backs off";
}

TEST_F(LateBusTest, WhatWaitingDoesNotHelpIsSaidAtOnceAndSomebodyMayGiveUp) {
  const Opened none =
      open_late_can_bus(late(), []() -> Opened { return fail(ErrorCode::kConfiguration, "no CAN"); });
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, "no CAN");
  EXPECT_EQ(looks_, 0);
  EXPECT_TRUE(told_.empty());
  gives_up_ = true;
  EXPECT_FALSE(open_late_can_bus(late(), is_missing));
  EXPECT_EQ(looks_, 1);
}

}  // namespace
}  // namespace cairn
