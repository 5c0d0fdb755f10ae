// SPDX-License-Identifier: Apache-2.0
#include "hw/can/frame.h"

#include <algorithm>
#include <cstdio>

namespace cairn {
namespace {

constexpr uint32_t kStandardBits = 0x7FF;
constexpr uint32_t kExtendedBits = 0x1FFF'FFFF;
constexpr std::array<uint8_t, 7> kLongLengths = {12, 16, 20, 24, 32, 48, 64};

uint32_t bits_of(CanId id) {
  return id.extended ? kExtendedBits : kStandardBits;
}

std::string hex(const char* format, uint32_t value) {
  std::array<char, 16> text{};
  const int length = std::snprintf(text.data(), text.size(), format, value);
  return {text.data(), static_cast<size_t>(length)};
}

}  // namespace

bool is_valid(const CanFrame& frame) {
  if ((frame.id.value & ~bits_of(frame.id)) != 0 || (frame.fast_data && !frame.fd)) return false;
  if (frame.length <= kMaxClassicPayload) return !(frame.fd && frame.remote);
  return frame.fd && !frame.remote &&
         std::find(kLongLengths.begin(), kLongLengths.end(), frame.length) != kLongLengths.end();
}

CanFilter CanFilter::only(CanId id) {
  return {id, bits_of(id)};
}

bool matches(const CanFilter& filter, const CanFrame& frame) {
  return filter.id.extended == frame.id.extended && ((filter.id.value ^ frame.id.value) & filter.mask) == 0;
}

bool passes(const std::vector<CanFilter>& filters, const CanFrame& frame) {
  return filters.empty() || std::any_of(filters.begin(), filters.end(),
                                        [&](const CanFilter& filter) { return matches(filter, frame); });
}

std::string to_string(CanId id) {
  return hex(id.extended ? "%08X" : "%03X", id.value);
}

std::string to_string(const CanFrame& frame) {
  std::string text = to_string(frame.id);
  if (frame.remote) return text + "#R" + std::to_string(frame.length);
  text += frame.fd ? "##" + std::to_string(static_cast<int>(frame.fast_data)) : "#";
  for (const uint8_t byte : frame.payload()) text += hex("%02X", byte);
  return text;
}

}  // namespace cairn
