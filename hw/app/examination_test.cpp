// SPDX-License-Identifier: Apache-2.0
#include "hw/app/examination.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can/netlink.h>

#include <algorithm>

#include "hw/app/bridge_bench.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

std::string failures(const std::vector<Check>& checks) {
  std::string text;
  for (const Check& check : checks) {
    if (!check.passed) text += check.what + "\n";
  }
  return text;
}

/// Two seconds of the devices of a configuration, listened to with `asked`.
std::string examine(const std::string& asked, std::optional<DeviceFault> fault = std::nullopt) {
  const auto devices = testing::read_rig(testing::kRigText).value();
  auto ends = make_bus_pair().value();
  MonotonicTime now{1h};
  SimulatedRig rig(devices, {}, 1, now, [](const std::string&) {});
  if (fault) rig.inject(*fault, std::nullopt, now);
  Examination examination(testing::read_rig(asked).value());
  for (int i = 0; i < 2000; ++i) {
    rig.turn(*ends.second, now += 1ms);
    while (const auto frame = ends.first->receive()) examination.receive(frame->frame);
  }
  return failures(examination.conclude(2s, 500'000));
}

std::string with(const std::string& what, const std::string& instead) {
  std::string text = testing::kRigText;
  return text.replace(text.find(what), what.size(), instead);
}

TEST(Examination, ASoundRigPasses) {
  EXPECT_EQ(examine(testing::kRigText), "");
}

TEST(Examination, EachFaultIsNamedWithItsRemedy) {
  EXPECT_THAT(examine(testing::kRigText, DeviceFault::kMutePan), HasSubstr("pan (node 16): no heartbeats"));
  EXPECT_THAT(examine(testing::kRigText, DeviceFault::kMuteImu), HasSubstr("IMU: no SampleTime"));
  EXPECT_THAT(examine(testing::kRigText, DeviceFault::kImuRate), HasSubstr("`imu: rate:` says 100"));
  const std::string other_node = examine(with("node: 17", "node: 21"));
  EXPECT_THAT(other_node, HasSubstr("tilt (node 21): no heartbeats"));
  EXPECT_THAT(other_node, HasSubstr("other node numbers: 17"));
}

TEST(Examination, DrivesThatSayTheirErrorsOrNoAngleAreNamed) {
  Examination examination(testing::read_rig(testing::kRigText).value());
  for (int i = 0; i < 20; ++i) {
    examination.receive(
        *odrive::encode({16}, odrive::Heartbeat{.axis_error = odrive::kErrorWatchdogExpired}));
  }
  const std::string found = failures(examination.conclude(2s, std::nullopt));
  EXPECT_THAT(found, HasSubstr("pan (node 16): its encoder is told 0 times"));
  EXPECT_THAT(found, HasSubstr("pan (node 16): errors 0x01000000"));
}

TEST(Examination, AFrameOfTheWrongLengthIsNamed) {
  Examination examination(testing::read_rig(testing::kRigText).value());
  for (int i = 0; i < 3; ++i) examination.receive({.id = {0x201, false}, .length = 7});
  const std::string found = failures(examination.conclude(2s, std::nullopt));
  EXPECT_THAT(found, HasSubstr("frame 201: 7 bytes, not the 8"));
  EXPECT_THAT(found, HasSubstr("3 frames"));
}

TEST(Examination, AnInterfaceIsJudgedAsTheKernelTellsOfIt) {
  const InterfaceFacts sound{.is_can = true,
                             .is_up = true,
                             .kind = "can",
                             .bit_rate = 500'000,
                             .restart_ms = 100,
                             .state = CAN_STATE_ERROR_ACTIVE,
                             .transmit_errors = 0,
                             .receive_errors = 0};
  EXPECT_EQ(failures(check_interface("can0", sound)), "");
  InterfaceFacts spoilt = sound;
  spoilt.is_up = false;
  EXPECT_THAT(failures(check_interface("can0", spoilt)), HasSubstr("sudo ip link set can0 up"));
  spoilt = sound;
  spoilt.bit_rate = 0;
  EXPECT_THAT(failures(check_interface("can0", spoilt)), HasSubstr("bit rate: not set"));
  spoilt = sound;
  spoilt.state = CAN_STATE_BUS_OFF;
  EXPECT_THAT(failures(check_interface("can0", spoilt)), HasSubstr("bus-off"));
  spoilt.state = CAN_STATE_ERROR_PASSIVE;
  EXPECT_THAT(failures(check_interface("can0", spoilt)), HasSubstr("terminated"));
  spoilt.is_can = false;
  EXPECT_THAT(failures(check_interface("can0", spoilt)), HasSubstr("no CAN interface"));
}

TEST(Examination, TheKernelTellsOfInterfaces) {
  const auto loopback = ask_interface("lo");
  ASSERT_TRUE(loopback);
  EXPECT_FALSE(loopback->is_can);
  const auto none = ask_interface("cairn-none");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(none.error().message, HasSubstr("ip -br link"));
}

TEST(DeviceFaults, AreReadOrNamed) {
  const auto fault = parse_timed_fault("stuck-pan@2.5+0.25");
  ASSERT_TRUE(fault);
  EXPECT_EQ(fault->what, DeviceFault::kStuckPan);
  EXPECT_EQ(fault->at, 2500ms);
  EXPECT_EQ(fault->lasts, 250ms);
  EXPECT_FALSE(parse_timed_fault("drop@1")->lasts);
  for (const char* text : {"", "drop", "drop@", "drop@x", "drop@-1", "drop@nan", "drop@1+", "drop@1+x",
                           "drop@1e9", "lost@1", "drop@1 "})
    EXPECT_FALSE(parse_timed_fault(text)) << text;
  EXPECT_THAT(parse_timed_fault("lost@1").error().message, HasSubstr("stuck-pan"));
}

}  // namespace
}  // namespace cairn
