// SPDX-License-Identifier: Apache-2.0
// CanBus on the kernel's CAN. As root, on a kernel that has it: tests/can-guest/run-in-can-guest.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/socket.h>

#include <cstdlib>
#include <random>
#include <thread>

#include "hw/can/kernel_frame.h"
#include "hw/can/socket_bus.h"
#include "hw/can/stamp_clock.h"
#include "hw/can/test_frames.h"
#include "hw/can/test_seed.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::expect_next;
using testing::frame;
using ::testing::HasSubstr;
using testing::soon;

void run(const std::string& command) {
  ASSERT_EQ(std::system(("exec " + command).c_str()), 0) << command;
}

std::unique_ptr<CanBus> opened(const std::string& interface_name,
                               const std::vector<CanFilter>& filters = {}) {
  auto bus = open_can_bus(interface_name, filters);
  EXPECT_TRUE(bus) << (bus ? "" : bus.error().message);
  return bus ? std::move(*bus) : nullptr;
}

/// Receives until `holds`, or fails.
template <typename Condition>
::testing::AssertionResult becomes(CanBus& bus, Condition holds) {
  const auto deadline = soon();
  while (!holds()) {
    if (steady_clock::now() >= deadline)
      return ::testing::AssertionFailure() << describe(bus.health(), "the bus");
    (void)receive_until(bus, steady_clock::now() + milliseconds(5));
  }
  return ::testing::AssertionSuccess();
}

/// With a virtual interface of CAN FD that is up. It is made once, for in the guest a process takes a tenth
/// of a second; a test that leaves it otherwise removes it.
class Vcan : public ::testing::Test {
 protected:
  void SetUp() override {
    if (if_nametoindex(kName) == 0) make();
  }
  static void TearDownTestSuite() {
    if (if_nametoindex(kName) != 0) remove();
  }
  static void make() { run("ip link add cantest mtu 72 up type vcan"); }
  static void remove() { run("ip link del cantest"); }

  static constexpr const char* kName = "cantest";
};

TEST_F(Vcan, FramesOfAllKindsComeAsTheyWereSentAndNotToWhoSentThem) {
  const auto sender = opened(kName);
  const auto receiver = opened(kName);
  for (const CanFrame& sent :
       {frame(0x123, 5), CanFrame{.id = {0x0CF029E2, true}, .length = 8, .data = {1, 2}},
        CanFrame{.id = {0x209, false}, .remote = true, .length = 8},
        CanFrame{.id = {0x245, false}, .fd = true, .fast_data = true, .length = 64}}) {
    ASSERT_EQ(sender->send(sent), SendOutcome::kQueued);
    expect_next(*receiver, sent);
  }
  EXPECT_FALSE(sender->receive());
}

TEST_F(Vcan, TheKernelsFiltersPassWhatPassesSays) {
  const uint32_t seed = testing::any_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto below = [&](uint32_t n) { return std::uniform_int_distribution<uint32_t>(0, n - 1)(random); };
  // Few bits, so that many identifiers meet.
  const auto some_id = [&] { return CanId{below(16), below(2) == 1}; };
  const auto sender = opened(kName);
  for (int round = 0; round < 20; ++round) {
    std::vector<CanFilter> filters(below(3));
    for (CanFilter& filter : filters) filter = {some_id(), below(16)};
    const auto receiver = opened(kName, filters);
    std::vector<CanFrame> expected;
    for (int i = 0; i < 50; ++i) {
      const CanFrame sent{.id = some_id(), .remote = below(4) == 0};
      ASSERT_EQ(sender->send(sent), SendOutcome::kQueued);
      if (passes(filters, sent)) expected.push_back(sent);
    }
    for (const CanFrame& sent : expected) {
      expect_next(*receiver, sent);
    }
    EXPECT_FALSE(receiver->receive());
  }
}

/// Sends a burst and reads it well after that: whether each stamp is of the time of sending.
bool stamps_are_of_sending(CanBus& sender, CanBus& receiver) {
  const auto before = StampClock::read();
  for (uint8_t i = 0; i < 20; ++i) EXPECT_EQ(sender.send(frame(0x100, i)), SendOutcome::kQueued);
  const auto after = StampClock::read();
  std::this_thread::sleep_for(milliseconds(20));
  bool all = true;
  Timestamp last{before.wall - 1'000'000};
  for (uint8_t i = 0; i < 20; ++i) {
    const auto got = receive_until(receiver, soon());
    if (!got) return false;
    EXPECT_GE(got->stamp, last);
    last = got->stamp;
    all = all && got->stamp.nanoseconds <= after.wall + 5'000'000;
  }
  return all;
}

TEST_F(Vcan, StampsAreOfTheTimeOfSendingAndNotOfReading) {
  const auto sender = opened(kName);
  const auto receiver = opened(kName);
  const auto deadline = soon();
  // The kernel takes some time to begin with stamps.
  while (!stamps_are_of_sending(*sender, *receiver)) ASSERT_LT(steady_clock::now(), deadline);
  EXPECT_TRUE(stamps_are_of_sending(*sender, *receiver)) << "and goes on with them";
}

/// Writes an error frame, as a driver would make it.
void report_error(uint32_t error_class, uint8_t controller = 0) {
  const int socket = ::socket(PF_CAN, SOCK_RAW, CAN_RAW);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex("cantest"));
  ASSERT_EQ(bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  can_frame error{};
  error.can_id = CAN_ERR_FLAG | error_class;
  error.len = CAN_ERR_DLC;
  error.data[1] = controller;
  ASSERT_EQ(write(socket, &error, sizeof error), static_cast<ssize_t>(sizeof error));
  close(socket);
}

TEST_F(Vcan, ErrorFramesAreCountedAndNamed) {
  const auto bus = opened(kName, {CanFilter::only({0x1, false})});
  const auto other = opened(kName);
  report_error(CAN_ERR_LOSTARB);
  report_error(CAN_ERR_ACK | CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  ASSERT_TRUE(becomes(*bus, [&] { return bus->health().error_frames == 2; }));
  EXPECT_EQ(bus->health().condition, BusCondition::kErrorPassive);
  EXPECT_EQ(bus->health().arbitration_lost, 1U);
  EXPECT_EQ(bus->health().no_acknowledge, 1U);
  EXPECT_THAT(describe(bus->health(), kName), HasSubstr("error passive, no acknowledge"));

  report_error(CAN_ERR_BUSOFF);
  ASSERT_TRUE(becomes(*bus, [&] { return bus->health().condition == BusCondition::kBusOff; }));
  ASSERT_TRUE(becomes(*other, [&] { return other->health().condition == BusCondition::kBusOff; }));
  EXPECT_EQ(bus->send(frame(0x2)), SendOutcome::kWithheld);
  EXPECT_EQ(bus->send(frame(0x3), Urgency::kUrgent), SendOutcome::kQueued);
  expect_next(*other, frame(0x3));
  EXPECT_EQ(other->health().condition, BusCondition::kUp) << "who receives is not bus-off";
  report_error(CAN_ERR_RESTARTED);
  ASSERT_TRUE(becomes(*bus, [&] { return bus->health().condition == BusCondition::kUp; }));
  EXPECT_EQ(bus->send(frame(0x2)), SendOutcome::kQueued);
}

TEST_F(Vcan, FramesThatFindTheReceiveQueueFullAreCounted) {
  const auto sender = opened(kName);
  const auto receiver = opened(kName);
  const int smallest = 1;
  ASSERT_EQ(setsockopt(receiver->descriptor(), SOL_SOCKET, SO_RCVBUF, &smallest, sizeof smallest), 0);
  const auto send = [&](int count) {
    for (int i = 0; i < count; ++i) ASSERT_EQ(sender->send(frame(0x300)), SendOutcome::kQueued);
  };
  send(500);
  while (receiver->receive()) continue;
  EXPECT_LT(receiver->health().received, 500U);
  send(1);  // The count comes with the next frame.
  ASSERT_TRUE(receive_until(*receiver, soon()));
  EXPECT_EQ(receiver->health().received + receiver->health().lost, 501U);
}

TEST_F(Vcan, AnInterfaceThatGoesDownIsUsedAgainWhenItIsUp) {
  const auto other = opened(kName);
  const auto bus = opened(kName);
  run("ip link set cantest down");
  ASSERT_TRUE(becomes(*bus, [&] { return bus->health().condition == BusCondition::kInterfaceDown; }));
  EXPECT_THAT(describe(bus->health(), kName), HasSubstr("cantest: the interface is down; `sudo ip link set"));
  EXPECT_EQ(bus->send(frame(1)), SendOutcome::kWithheld);
  EXPECT_EQ(bus->send(frame(1), Urgency::kUrgent), SendOutcome::kWithheld);
  run("ip link set cantest up");
  // Nobody sends: that it is up again must be seen by itself.
  ASSERT_TRUE(becomes(*bus, [&] { return bus->health().condition == BusCondition::kUp; }));
  EXPECT_EQ(bus->health().restored, 1U);
  ASSERT_TRUE(becomes(*other, [&] { return other->health().restored == 1; }));
  ASSERT_EQ(bus->send(frame(2)), SendOutcome::kQueued);
  expect_next(*other, frame(2));
}

TEST_F(Vcan, ASenderThatNeverReceivesFindsOutToo) {
  const auto bus = opened(kName);
  run("ip link set cantest down");
  EXPECT_EQ(bus->send(frame(1)), SendOutcome::kWithheld);
  EXPECT_EQ(bus->health().condition, BusCondition::kInterfaceDown);
  run("ip link set cantest up");
  const auto deadline = soon();
  while (bus->send(frame(2)) != SendOutcome::kQueued) ASSERT_LT(steady_clock::now(), deadline);
  EXPECT_EQ(bus->health().condition, BusCondition::kUp);
}

TEST_F(Vcan, AnInterfaceThatIsDeletedIsUsedAgainWhenItIsMadeAnewWithItsFilters) {
  const auto bus = opened(kName, {CanFilter::only({0x201, false})});
  const int descriptor = bus->descriptor();
  for (uint64_t times = 1; times <= 2; ++times) {
    remove();
    ASSERT_TRUE(becomes(*bus, [&] { return bus->health().condition == BusCondition::kInterfaceGone; }));
    EXPECT_THAT(describe(bus->health(), kName), HasSubstr("cantest: there is no such interface any more"));
    EXPECT_EQ(bus->send(frame(1), Urgency::kUrgent), SendOutcome::kWithheld);
    make();
    // Who wants to stop the drives all the time does not keep the interface from being found.
    ASSERT_TRUE(becomes(*bus, [&] { return bus->send(frame(1), Urgency::kUrgent) == SendOutcome::kQueued; }));
    EXPECT_EQ(bus->health().condition, BusCondition::kUp);
    EXPECT_EQ(bus->health().restored, times);
    EXPECT_EQ(bus->descriptor(), descriptor);
    const auto other = opened(kName);
    ASSERT_EQ(bus->send(frame(0x99)), SendOutcome::kQueued);
    expect_next(*other, frame(0x99));
    ASSERT_EQ(other->send(frame(0x200)), SendOutcome::kQueued);
    ASSERT_EQ(other->send(frame(0x201)), SendOutcome::kQueued);
    expect_next(*bus, frame(0x201));
  }
}

TEST_F(Vcan, AFullTransmitQueueWithholdsAndPasses) {
  // A virtual bus has no queue of its own; this one holds two frames, for 200 ms each.
  if (std::system("tc qdisc add dev cantest root netem delay 200ms limit 2 2>/dev/null") != 0) {
    GTEST_SKIP() << "this kernel has no netem";
  }
  const auto bus = opened(kName);
  const auto other = opened(kName);
  int queued = 0;
  while (bus->send(frame(0x100), Urgency::kUrgent) == SendOutcome::kQueued) ASSERT_LT(++queued, 1000);
  EXPECT_EQ(bus->health().condition, BusCondition::kQueueFull);
  EXPECT_THAT(describe(bus->health(), kName), HasSubstr("cantest: the transmit queue is full"));
  EXPECT_EQ(bus->send(frame(0x101)), SendOutcome::kWithheld);
  const auto deadline = soon();
  while (bus->send(frame(0x102)) != SendOutcome::kQueued) ASSERT_LT(steady_clock::now(), deadline);
  EXPECT_EQ(bus->health().condition, BusCondition::kUp);
  for (int i = 0; i < queued; ++i) expect_next(*other, frame(0x100));
  expect_next(*other, frame(0x102));  // What was withheld never comes.
  remove();
}

TEST_F(Vcan, AClassicInterfaceTakesNoFrameOfCanFd) {
  run("ip link set cantest down");
  run("ip link set cantest mtu 16 up");
  const auto bus = opened(kName);
  EXPECT_EQ(bus->send({.id = {1, false}, .fd = true, .length = 8}), SendOutcome::kInvalid);
  EXPECT_EQ(bus->health().condition, BusCondition::kUp);
  EXPECT_EQ(bus->send(frame(1)), SendOutcome::kQueued);
  remove();
}

TEST_F(Vcan, WhatCannotBeOpenedIsToldApart) {
  const auto none = open_can_bus("nocan7");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(none.error().message, HasSubstr("nocan7: no such interface"));
  const auto other_kind = open_can_bus("lo");
  ASSERT_FALSE(other_kind);
  EXPECT_EQ(other_kind.error().code, ErrorCode::kConfiguration);
  EXPECT_THAT(other_kind.error().message, HasSubstr("lo: not a CAN interface"));
  run("ip link set cantest down");
  const auto down = opened(kName);
  EXPECT_EQ(down->health().condition, BusCondition::kInterfaceDown);
  run("ip link set cantest up");
  EXPECT_TRUE(becomes(*down, [&] { return down->health().condition == BusCondition::kUp; }));
}

// Two emulated SJA1000 with the kernel's driver for them, on one bus of classic CAN.
TEST(Controllers, FramesPassBetweenThemAndAnInterfaceComesBack) {
  if (if_nametoindex("can0") == 0 || if_nametoindex("can1") == 0)
    GTEST_SKIP() << "no can0 and can1 here (--kvaser)";
  const auto first = opened("can0");
  const auto second = opened("can1");
  for (uint8_t i = 0; i < 20; ++i) {
    ASSERT_EQ(first->send(frame(0x200, i)), SendOutcome::kQueued);
    expect_next(*second, frame(0x200, i));
  }
  EXPECT_EQ(first->send({.id = {1, false}, .fd = true, .length = 8}), SendOutcome::kInvalid);
  run("ip link set can1 down");
  ASSERT_TRUE(becomes(*second, [&] { return second->health().condition == BusCondition::kInterfaceDown; }));
  run("ip link set can1 up");
  ASSERT_TRUE(becomes(*second, [&] { return second->health().condition == BusCondition::kUp; }));
  ASSERT_EQ(second->send(frame(0x201)), SendOutcome::kQueued);
  expect_next(*first, frame(0x201));
}

}  // namespace
}  // namespace cairn
