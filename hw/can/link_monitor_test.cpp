// SPDX-License-Identifier: Apache-2.0
#include "hw/can/link_monitor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using ::testing::HasSubstr;

MonotonicTime at(int ms) {
  return MonotonicTime(std::chrono::hours(1)) + milliseconds(ms);
}

BusErrors errors(std::initializer_list<BusFault> faults) {
  BusErrors all;
  for (const BusFault fault : faults) all.add(fault);
  return all;
}

TEST(Backoff, DoublesUpToTheLongestAndBeginsAnewAfterSuccess) {
  Backoff backoff(milliseconds(10), milliseconds(35));
  EXPECT_TRUE(backoff.due(at(0)));
  int now = 0;
  for (const int wait : {10, 20, 35, 35}) {
    backoff.failed(at(now));
    EXPECT_EQ(backoff.retry_at(), at(now + wait));
    EXPECT_FALSE(backoff.due(at(now + wait - 1)));
    now += wait;
    EXPECT_TRUE(backoff.due(at(now)));
  }
  backoff.succeeded();
  EXPECT_FALSE(backoff.retry_at());
  backoff.failed(at(5));
  EXPECT_EQ(backoff.retry_at(), at(15));
}

TEST(LinkMonitor, EachFailureHasItsConditionAndWordsThatHelp) {
  struct Case {
    int error;
    BusCondition condition;
    const char* words;
  };
  for (const Case& c :
       {Case{ENETDOWN, BusCondition::kInterfaceDown, "can0: the interface is down; `sudo ip link set"},
        Case{ENODEV, BusCondition::kInterfaceGone, "can0: there is no such interface any more; is its"},
        Case{ENXIO, BusCondition::kInterfaceGone, "is its adapter plugged in?"},
        Case{ENOBUFS, BusCondition::kQueueFull, "can0: the transmit queue is full; is another node"},
        Case{EAGAIN, BusCondition::kQueueFull, "full"},
        Case{EPERM, BusCondition::kFault, "can0: the system refuses it: Operation not permitted"}}) {
    LinkMonitor monitor;
    EXPECT_EQ(describe(monitor.health(), "can0"), "");
    monitor.send_failed(c.error, at(0));
    EXPECT_EQ(monitor.health().condition, c.condition) << c.error;
    EXPECT_EQ(monitor.health().withheld, 1U);
    EXPECT_THAT(describe(monitor.health(), "can0"), HasSubstr(c.words));
    EXPECT_FALSE(monitor.may_send(at(0)));
    EXPECT_TRUE(monitor.may_send(at(10)));
    monitor.sent();
    EXPECT_EQ(monitor.health().condition, BusCondition::kUp) << c.error;
    EXPECT_TRUE(monitor.may_send(at(10)));
  }
}

TEST(LinkMonitor, AnInterfaceThatIsAwayIsLookedAtFiveTimesASecondAtLeast) {
  LinkMonitor monitor;
  int looks = 0;
  for (int ms = 0; ms < 10'000; ++ms) {
    if (const auto due = monitor.link_retry_at(); due && at(ms) < *due) continue;
    monitor.link_failed(ENODEV, at(ms));
    ++looks;
  }
  EXPECT_GE(looks, 50);
  EXPECT_LE(looks, 60);
  monitor.link_works();
  EXPECT_EQ(monitor.health().restored, 1U);
  EXPECT_FALSE(monitor.link_retry_at());
}

TEST(LinkMonitor, UrgentFramesThatFailDoNotPutTheNextLookAtTheInterfaceOff) {
  LinkMonitor monitor;
  monitor.link_failed(ENODEV, at(0));
  int looks = 0;
  for (int ms = 1; ms < 2000; ++ms) {
    monitor.send_failed(ENXIO, at(ms));
    if (at(ms) < *monitor.link_retry_at()) continue;
    monitor.link_failed(ENODEV, at(ms));
    ++looks;
  }
  EXPECT_GE(looks, 10);
}

TEST(LinkMonitor, NothingIsQueuedWhileTheControllerIsBusOff) {
  LinkMonitor monitor;
  monitor.noticed(errors({BusFault::kNoAcknowledge, BusFault::kBusOff}), at(0));
  EXPECT_EQ(monitor.health().condition, BusCondition::kBusOff);
  EXPECT_THAT(describe(monitor.health(), "can0"),
              HasSubstr("bus-off (no acknowledge, bus-off); check wiring"));
  for (int ms = 0; ms < 5000; ms += 10) EXPECT_FALSE(monitor.may_send(at(ms)));
  // An urgent frame is tried all the same, and a driver that has no room for it is not a full queue.
  monitor.send_failed(ENOBUFS, at(5000));
  EXPECT_EQ(monitor.health().condition, BusCondition::kBusOff);
  monitor.sent();
  EXPECT_EQ(monitor.health().condition, BusCondition::kBusOff);
  EXPECT_EQ(monitor.health().bus_off, 1U);
}

TEST(LinkMonitor, BusOffIsOverWhenTheControllerSaysSoReceivesOrBeginsAnew) {
  const auto bus_off = [] {
    LinkMonitor monitor;
    monitor.noticed(errors({BusFault::kBusOff}), at(0));
    return monitor;
  };
  for (const BusFault fault : {BusFault::kRestarted, BusFault::kErrorActive}) {
    LinkMonitor told = bus_off();
    told.noticed(errors({fault}), at(10));
    EXPECT_EQ(told.health().condition, BusCondition::kUp);
    EXPECT_TRUE(told.may_send(at(10)));
  }
  LinkMonitor receiving = bus_off();
  receiving.received(at(10));
  EXPECT_EQ(receiving.health().condition, BusCondition::kUp);

  LinkMonitor begun_anew = bus_off();
  begun_anew.link_failed(ENETDOWN, at(10));
  begun_anew.link_works();
  EXPECT_EQ(begun_anew.health().condition, BusCondition::kUp);

  LinkMonitor passive = bus_off();
  passive.noticed(errors({BusFault::kErrorPassive}), at(10));
  EXPECT_EQ(passive.health().condition, BusCondition::kBusOff)
      << "it is not over by an error of another kind";
}

TEST(LinkMonitor, ErrorPassiveHindersNothingAndEndsAfterASecondOfFramesWithoutErrors) {
  LinkMonitor monitor;
  monitor.noticed(errors({BusFault::kErrorPassive, BusFault::kArbitrationLost}), at(0));
  EXPECT_EQ(monitor.health().condition, BusCondition::kErrorPassive);
  EXPECT_TRUE(monitor.may_send(at(0)));
  monitor.received(at(500));
  monitor.noticed(errors({BusFault::kNoAcknowledge}), at(600));
  monitor.received(at(1500));
  EXPECT_EQ(monitor.health().condition, BusCondition::kErrorPassive);
  monitor.received(at(1600));
  EXPECT_EQ(monitor.health().condition, BusCondition::kUp);
  EXPECT_EQ(monitor.health().error_frames, 2U);
  EXPECT_EQ(monitor.health().arbitration_lost, 1U);
  EXPECT_EQ(monitor.health().no_acknowledge, 1U);
}

TEST(LinkMonitor, TheKernelsCountOfLostFramesMayWrap) {
  LinkMonitor monitor;
  monitor.lost_so_far(0xFFFF'FFFE);
  const uint64_t before = monitor.health().lost;
  monitor.lost_so_far(3);
  EXPECT_EQ(monitor.health().lost - before, 5U);
}

}  // namespace
}  // namespace cairn
