// SPDX-License-Identifier: Apache-2.0
#include "hw/can/bus_errors.h"

#include <gtest/gtest.h>
#include <linux/can/error.h>

namespace cairn {
namespace {

BusErrors of(uint32_t error_class, uint8_t controller = 0) {
  return decode_error_frame(error_class, {0, controller});
}

TEST(BusErrors, EachKindOfTheKernelHasItsName) {
  struct Case {
    uint32_t error_class;
    uint8_t controller;
    const char* words;
  };
  for (const Case& c :
       {Case{CAN_ERR_TX_TIMEOUT, 0, "transmit time-out"}, Case{CAN_ERR_LOSTARB, 0, "arbitration lost"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW, "receive overflow"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_TX_OVERFLOW, "transmit overflow"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_RX_WARNING, "error warning"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING, "error warning"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE, "error passive"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE, "error passive"},
        Case{CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE, "error active"}, Case{CAN_ERR_PROT, 0, "protocol violation"},
        Case{CAN_ERR_TRX, 0, "transceiver fault"}, Case{CAN_ERR_ACK, 0, "no acknowledge"},
        Case{CAN_ERR_BUSOFF, 0, "bus-off"}, Case{CAN_ERR_BUSERROR, 0, "bus error"},
        Case{CAN_ERR_RESTARTED, 0, "restarted"},
        Case{CAN_ERR_ACK | CAN_ERR_BUSOFF, 0, "no acknowledge, bus-off"}, Case{0, 0, "unnamed error"}}) {
    EXPECT_EQ(describe(of(c.error_class, c.controller)), c.words);
  }
}

TEST(BusErrors, TheControllersByteCountsOnlyWhereTheClassSaysSo) {
  EXPECT_EQ(of(CAN_ERR_ACK, CAN_ERR_CRTL_RX_PASSIVE), of(CAN_ERR_ACK));
}

TEST(BusErrors, CountersAreThereWhereTheDriverTellsThem) {
  EXPECT_FALSE(of(CAN_ERR_ACK).counters);
  const BusErrors silent = decode_error_frame(CAN_ERR_CNT, {});
  EXPECT_EQ(silent.counters, (BusErrors::Counters{0, 0}));
  const BusErrors old_kernel = decode_error_frame(CAN_ERR_ACK, {0, 0, 0, 0, 0, 0, 128, 3});
  EXPECT_EQ(old_kernel.counters, (BusErrors::Counters{128, 3}));
  EXPECT_EQ(describe(old_kernel), "no acknowledge (transmit errors 128, receive errors 3)");
}

}  // namespace
}  // namespace cairn
