// SPDX-License-Identifier: Apache-2.0
#include "common/wire/rig_messages.h"

#include <algorithm>

#include "common/base/enumerators.h"

namespace cairn::wire {
namespace {

constexpr std::array<std::string_view, kEnumerators<RigMode>> kNames = {
    "idle",    "home",   "neutral", "follow", "lock", "fixate",
    "saccade", "search", "jog",     "clear",  "stop", "clear-stop"};

}  // namespace

std::string_view name_of(RigMode mode) {
  const auto index = static_cast<size_t>(mode);
  return index < kNames.size() ? kNames.at(index) : "unknown";
}

std::optional<RigMode> parse_rig_mode(std::string_view name) {
  const auto* found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return std::nullopt;
  return static_cast<RigMode>(found - kNames.begin());
}

std::optional<RigSearchPattern> parse_rig_search(std::string_view name) {
  if (name == "spiral") return RigSearchPattern::kSpiral;
  if (name == "raster") return RigSearchPattern::kRaster;
  return std::nullopt;
}

std::optional<int64_t> camera_offset(const RigState& state) {
  return state.camera_clock.known ? std::optional(state.camera_clock.offset) : state.calibrated_offset;
}

}  // namespace cairn::wire
