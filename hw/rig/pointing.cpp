// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/pointing.h"

#include <array>

namespace cairn {
namespace {

constexpr std::array<const char*, std::variant_size_v<Pointing>> kWords = {
    "neutral", "jog", "follow", "lock", "fixate", "saccade", "search"};

}  // namespace

PointingMode mode_of(const Pointing& pointing) {
  return static_cast<PointingMode>(pointing.index());
}

const char* to_string(PointingMode mode) {
  return kWords.at(static_cast<size_t>(mode));
}

std::optional<PointingMode> pointing_mode(std::string_view word) {
  for (size_t i = 0; i < kWords.size(); ++i) {
    if (word == kWords.at(i)) return static_cast<PointingMode>(i);
  }
  return std::nullopt;
}

}  // namespace cairn
