// SPDX-License-Identifier: Apache-2.0
#include "hw/can/socket_bus.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <sys/socket.h>

#include <array>
#include <string>
#include <thread>

#include "common/base/cpu_time.h"
#include "common/base/file_descriptor.h"
#include "hw/can/kernel_frame.h"
#include "hw/can/stamp_clock.h"
#include "hw/can/test_frames.h"

// CanBus on a pair of sockets. On the kernel's CAN: can_socket_test.
namespace cairn {
namespace {

using std::chrono::steady_clock;
using testing::expect_next;
using testing::frame;
using ::testing::HasSubstr;
using testing::soon;

/// The two ends of a bus.
struct Pair {
  std::unique_ptr<CanBus> host;
  std::unique_ptr<CanBus> device;
};
Pair make_pair(const std::vector<CanFilter>& host_filters = {}) {
  auto made = make_bus_pair(host_filters);
  EXPECT_TRUE(made.has_value());
  return {std::move(made->first), std::move(made->second)};
}

TEST(BusPair, CarriesFramesBothWaysInOrderWithTheTimeThatTheyWereSent) {
  Pair bus = make_pair();
  const int64_t before = StampClock::read().wall;
  for (uint8_t i = 0; i < 100; ++i) ASSERT_EQ(bus.host->send(frame(0x200, i)), SendOutcome::kQueued);
  const int64_t after = StampClock::read().wall;
  Timestamp last{before};
  for (uint8_t i = 0; i < 100; ++i) {
    const auto got = receive_until(*bus.device, soon());
    ASSERT_TRUE(got);
    EXPECT_EQ(got->frame, frame(0x200, i));
    EXPECT_GE(got->stamp, last);
    // Two clocks are read one after the other, twice.
    EXPECT_LE(got->stamp.nanoseconds, after + 100'000);
    last = got->stamp;
  }
  const CanFrame long_one{
      .id = {0x1234567, true}, .fd = true, .fast_data = true, .length = 64, .data = {1, 2, 3}};
  ASSERT_EQ(bus.device->send(long_one), SendOutcome::kQueued);
  expect_next(*bus.host, long_one);
  EXPECT_EQ(bus.host->health().sent, 100U);
  EXPECT_EQ(bus.device->health().received, 100U);
}

TEST(BusPair, GivesOnlyWhatAFilterPasses) {
  Pair bus = make_pair({CanFilter::only({0x201, false})});
  for (const uint32_t id : {0x200U, 0x201U, 0x202U, 0x201U})
    ASSERT_EQ(bus.device->send(frame(id)), SendOutcome::kQueued);
  expect_next(*bus.host, frame(0x201));
  expect_next(*bus.host, frame(0x201));
  EXPECT_FALSE(bus.host->receive());
  EXPECT_EQ(bus.host->health().received, 2U);
}

TEST(BusPair, AFrameThatNoBusCarriesIsInvalidAndIsNotSent) {
  Pair bus = make_pair();
  EXPECT_EQ(bus.host->send(frame(0x800)), SendOutcome::kInvalid);
  EXPECT_FALSE(bus.device->receive());
  EXPECT_EQ(bus.host->health().condition, BusCondition::kUp);
}

TEST(BusPair, AFullQueueWithholdsFramesAndPassesWhenTheyAreTaken) {
  Pair bus = make_pair();
  int sent = 0;
  while (bus.host->send(frame(0x200), Urgency::kUrgent) == SendOutcome::kQueued) ++sent;
  EXPECT_EQ(bus.host->health().condition, BusCondition::kQueueFull);
  EXPECT_THAT(describe(bus.host->health(), "can0"), HasSubstr("the transmit queue is full"));
  for (int i = 0; i < sent; ++i) ASSERT_TRUE(bus.device->receive());
  EXPECT_FALSE(bus.device->receive()) << "what was withheld never comes";
  const auto deadline = soon();
  while (bus.host->send(frame(0x201)) != SendOutcome::kQueued) {
    ASSERT_LT(steady_clock::now(), deadline);
    std::this_thread::yield();
  }
  expect_next(*bus.device, frame(0x201));
  EXPECT_EQ(bus.host->health().condition, BusCondition::kUp);
}

TEST(BusPair, WhenTheOtherEndGoesTheInterfaceIsGoneAndWaitingGoesOnWithoutSpinning) {
  Pair bus = make_pair();
  bus.device.reset();
  const auto cpu_before = thread_cpu_time();
  EXPECT_FALSE(receive_until(*bus.host, steady_clock::now() + std::chrono::milliseconds(100)));
  EXPECT_LT(thread_cpu_time() - cpu_before, std::chrono::milliseconds(30));
  EXPECT_EQ(bus.host->health().condition, BusCondition::kInterfaceGone);
  EXPECT_EQ(bus.host->descriptor(), -1);
  EXPECT_EQ(bus.host->send(frame(0x200), Urgency::kUrgent), SendOutcome::kWithheld);
}

/// What a driver would say.
void report_error(const CanBus& from, uint32_t error_class) {
  KernelFrame kernel{{}, CAN_MTU};
  kernel.frame.can_id = CAN_ERR_FLAG | error_class;
  kernel.frame.len = CAN_ERR_DLC;
  ASSERT_EQ(send(from.descriptor(), &kernel.frame, kernel.size, 0), static_cast<ssize_t>(kernel.size));
}

TEST(BusPair, WhileBusOffOnlyAnUrgentFrameIsTried) {
  Pair bus = make_pair();
  report_error(*bus.device, CAN_ERR_BUSOFF);
  EXPECT_FALSE(bus.host->receive());
  EXPECT_EQ(bus.host->health().condition, BusCondition::kBusOff);
  EXPECT_EQ(bus.host->send(frame(0x200)), SendOutcome::kWithheld);
  EXPECT_EQ(bus.host->send(frame(0x201), Urgency::kUrgent), SendOutcome::kQueued);
  expect_next(*bus.device, frame(0x201));
  report_error(*bus.device, CAN_ERR_RESTARTED);
  EXPECT_FALSE(bus.host->receive());
  EXPECT_EQ(bus.host->health().condition, BusCondition::kUp);
  EXPECT_EQ(bus.host->send(frame(0x200)), SendOutcome::kQueued);
}

TEST(BusPair, BytesThatAreNoFrameAreLeftOut) {
  Pair bus = make_pair();
  ASSERT_EQ(send(bus.device->descriptor(), "abc", 3, 0), 3);
  ASSERT_EQ(bus.device->send(frame(0x200)), SendOutcome::kQueued);
  expect_next(*bus.host, frame(0x200));
}

TEST(BusPair, AThousandFramesASecondCostLessThanATenthOfACore) {
  Pair bus = make_pair();
  constexpr int kFrames = 5000;
  const auto before = thread_cpu_time();
  for (int i = 0; i < kFrames; ++i) {
    ASSERT_EQ(bus.host->send(frame(0x200)), SendOutcome::kQueued);
    ASSERT_TRUE(receive_until(*bus.device, soon()));
  }
  const double cost = std::chrono::duration<double, std::micro>(thread_cpu_time() - before).count() / kFrames;
  RecordProperty("microseconds_per_frame", std::to_string(cost));
  EXPECT_LT(cost, 100) << "us per frame, of 1000 us; sent and received";
}

TEST(OpenCanBus, NamesThatNoInterfaceHasAreRefused) {
  for (const char* name : {"", "a-name-of-sixteen"}) {
    const auto bus = open_can_bus(name);
    ASSERT_FALSE(bus);
    EXPECT_EQ(bus.error().code, ErrorCode::kUsage);
    EXPECT_THAT(bus.error().message, HasSubstr("1 to 15 letters"));
  }
  const auto many = open_can_bus("can0", std::vector<CanFilter>(513));
  ASSERT_FALSE(many);
  EXPECT_THAT(many.error().message, HasSubstr("can0: 513 filters; the kernel takes 512"));
}

TEST(OpenCanBus, AnEndThatTheProcessWasStartedWithIsABusAndForgetsWhatCameBefore) {
  std::array<int, 2> ends{-1, -1};
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()), 0);
  const auto name = [&](size_t end) { return "fd:" + std::to_string(ends.at(end)); };
  const auto device = open_can_bus(name(0));
  ASSERT_TRUE(device) << device.error().message;
  ASSERT_EQ((*device)->send(frame(0x200)), SendOutcome::kQueued);
  auto host = open_can_bus(name(1));
  ASSERT_TRUE(host) << host.error().message;
  ASSERT_EQ((*device)->send(frame(0x201)), SendOutcome::kQueued);
  expect_next(**host, frame(0x201));
  ASSERT_EQ((*host)->send(frame(0x202)), SendOutcome::kQueued);
  expect_next(**device, frame(0x202));
  host->reset();
  EXPECT_FALSE((*device)->receive());
  EXPECT_EQ((*device)->health().condition, BusCondition::kInterfaceGone);
}

TEST(OpenCanBus, WhatIsNoSuchEndIsRefused) {
  const FileDescriptor stream(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  for (const std::string& number : {std::to_string(stream.get()), std::string("9999"), std::string("-1"),
                                    std::string("2x"), std::string()}) {
    const auto bus = open_can_bus("fd:" + number);
    ASSERT_FALSE(bus) << number;
    EXPECT_EQ(bus.error().code, ErrorCode::kConfiguration);
    EXPECT_THAT(bus.error().message, HasSubstr("fd:" + number + ": no local socket"));
  }
}

TEST(OpenCanBus, AnInterfaceThatIsNoneIsAnErrorThatSaysWhatHelps) {
  const auto bus = open_can_bus("nocan7");
  ASSERT_FALSE(bus);
  if (bus.error().code == ErrorCode::kIo) GTEST_SKIP() << bus.error().message;  // no right to any such socket
  EXPECT_THAT(bus.error().code, ::testing::AnyOf(ErrorCode::kNotFound, ErrorCode::kConfiguration));
  EXPECT_THAT(bus.error().message, ::testing::AnyOf(HasSubstr("nocan7: no such interface; `ip"),
                                                    HasSubstr("nocan7: this kernel has no CAN")));
}

}  // namespace
}  // namespace cairn
