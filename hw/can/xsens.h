// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <variant>
#include <vector>

#include "hw/can/codec_fault.h"

/// The CAN messages of Xsens MTi-600 that a rig needs: typed messages and their frames, in both directions,
/// so that the IMU can be simulated. Pure. A message is a part of one sample: those between two SampleTime or
/// GroupCounter belong together.
namespace cairn::xsens {

/// Inferred, not confirmed by the manual. hw/can/rig.dbc says it too, for each signal.
constexpr std::endian kByteOrder = std::endian::big;

/// Identifiers of the messages; they can be changed in the device. 11 bits.
struct Ids {
  uint32_t sample_time = 0x005;
  uint32_t group_counter = 0x006;
  uint32_t status_word = 0x011;
  uint32_t quaternion = 0x021;
  uint32_t euler = 0x022;
  uint32_t rate_of_turn = 0x032;
  uint32_t acceleration = 0x034;
};

struct SampleTime {
  uint32_t ticks = 0;  ///< of the IMU's own clock, 10 kHz; wraps
  bool operator==(const SampleTime&) const = default;
};
struct GroupCounter {
  uint16_t count = 0;  ///< of samples; wraps
  bool operator==(const GroupCounter&) const = default;
};
struct StatusWord {
  uint32_t bits = 0;  ///< as of the manual
  bool operator==(const StatusWord&) const = default;
};
/// The earth's frame from the sensor's (Z up), of length 1 to the rounding.
struct Quaternion {
  double x = 0;
  double y = 0;
  double z = 0;
  double w = 1;
  bool operator==(const Quaternion&) const = default;
};
struct Euler {
  double roll = 0;   ///< [rad]
  double pitch = 0;  ///< [rad]
  double yaw = 0;    ///< [rad]
  bool operator==(const Euler&) const = default;
};
struct RateOfTurn {
  std::array<double, 3> rate{};  ///< [rad/s] about the sensor's x, y, z
  bool operator==(const RateOfTurn&) const = default;
};
struct Acceleration {
  std::array<double, 3> acceleration{};  ///< [m/s^2] along the sensor's x, y, z; at rest it points up
  bool operator==(const Acceleration&) const = default;
};

using Message =
    std::variant<SampleTime, GroupCounter, StatusWord, Quaternion, Euler, RateOfTurn, Acceleration>;

/// Rounds to the message's steps. A value beyond its field becomes the field's end, as a sensor saturates;
/// error kUsage for a number that is not finite.
[[nodiscard]] Result<CanFrame> encode(const Message& message, const Ids& ids = {});
[[nodiscard]] Decoded<Message> decode(const CanFrame& frame, const Ids& ids = {});

/// Pass the messages above, and no others.
[[nodiscard]] std::vector<CanFilter> filters_of(const Ids& ids);

}  // namespace cairn::xsens
