// SPDX-License-Identifier: Apache-2.0
#include "hw/can/late_bus.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kFirst{50};  // between looks, doubled each time
constexpr std::chrono::milliseconds kLongest{1000};

}  // namespace

Result<std::unique_ptr<CanBus>> open_late_can_bus(
    const LateBus& late, const std::function<Result<std::unique_ptr<CanBus>>()>& open) {
  auto left = late.patience;
  auto wait = kFirst;
  while (true) {
    auto bus = open();
    if (bus || bus.error().code != ErrorCode::kNotFound || left.count() <= 0) return bus;
    if (left == late.patience)
      late.tell(bus.error().message + ". It is waited for, " +
                std::to_string(std::chrono::ceil<std::chrono::seconds>(left).count()) + " s");
    const auto step = std::min(wait, left);
    if (late.gives_up(step)) return bus;
    left -= step;
    wait = std::min(2 * wait, kLongest);
  }
}

}  // namespace cairn
