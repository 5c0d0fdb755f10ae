// SPDX-License-Identifier: Apache-2.0
#include "hw/can/bus_errors.h"

#include <linux/can.h>
#include <linux/can/error.h>

namespace cairn {
namespace {

struct Meaning {
  uint32_t bits;
  BusFault fault;
};
constexpr std::array<Meaning, 8> kClasses = {{{CAN_ERR_TX_TIMEOUT, BusFault::kTransmitTimeout},
                                              {CAN_ERR_LOSTARB, BusFault::kArbitrationLost},
                                              {CAN_ERR_PROT, BusFault::kProtocol},
                                              {CAN_ERR_TRX, BusFault::kTransceiver},
                                              {CAN_ERR_ACK, BusFault::kNoAcknowledge},
                                              {CAN_ERR_BUSOFF, BusFault::kBusOff},
                                              {CAN_ERR_BUSERROR, BusFault::kBusError},
                                              {CAN_ERR_RESTARTED, BusFault::kRestarted}}};
/// Meanings of the bits of byte 1, where the class says that it is the controller.
constexpr std::array<Meaning, 5> kController = {
    {{CAN_ERR_CRTL_RX_OVERFLOW, BusFault::kReceiveOverflow},
     {CAN_ERR_CRTL_TX_OVERFLOW, BusFault::kTransmitOverflow},
     {CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING, BusFault::kErrorWarning},
     {CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE, BusFault::kErrorPassive},
     {CAN_ERR_CRTL_ACTIVE, BusFault::kErrorActive}}};

constexpr std::array<const char*, kBusFaultKinds> kNames = {
    "transmit time-out", "arbitration lost", "receive overflow",   "transmit overflow", "error warning",
    "error passive",     "error active",     "protocol violation", "transceiver fault", "no acknowledge",
    "bus-off",           "bus error",        "restarted"};

template <size_t N>
void add_all(const std::array<Meaning, N>& meanings, uint32_t bits, BusErrors& errors) {
  for (const Meaning& meaning : meanings) {
    if ((bits & meaning.bits) != 0) errors.add(meaning.fault);
  }
}

}  // namespace

BusErrors decode_error_frame(uint32_t error_class, const std::array<uint8_t, 8>& data) {
  BusErrors errors;
  add_all(kClasses, error_class, errors);
  if ((error_class & CAN_ERR_CRTL) != 0) add_all(kController, data[1], errors);
  // Kernels before 6.0 fill in the counters without the flag, and leave both 0 where the driver has none.
  if ((error_class & CAN_ERR_CNT) != 0 || data[6] != 0 || data[7] != 0) errors.counters = {data[6], data[7]};
  return errors;
}

const char* name_of(BusFault fault) {
  return kNames[static_cast<size_t>(fault)];
}

std::string describe(const BusErrors& errors) {
  std::string text;
  for (size_t i = 0; i < kBusFaultKinds; ++i) {
    if (errors.has(static_cast<BusFault>(i))) text += (text.empty() ? "" : ", ") + std::string(kNames[i]);
  }
  if (text.empty()) text = "unnamed error";
  if (errors.counters) {
    text += " (transmit errors " + std::to_string(errors.counters->transmit) + ", receive errors " +
            std::to_string(errors.counters->receive) + ")";
  }
  return text;
}

}  // namespace cairn
