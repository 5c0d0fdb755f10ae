// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.h"
#include "hw/can/can_bus.h"

namespace cairn {

/// How to wait for an interface that is not there.
struct LateBus {
  std::chrono::milliseconds patience{10'000};
  std::function<void(const std::string&)> tell;             ///< once, that it is waited for
  std::function<bool(std::chrono::milliseconds)> gives_up;  ///< after so long, whether to end waiting
};

/// open_can_bus() of an interface that may come a little later, as that of an adapter does after a start of
/// the machine. One that is there and down is opened at once: the bus tells that. Errors: those of `open`;
/// kNotFound where it has not come in time.
[[nodiscard]] Result<std::unique_ptr<CanBus>> open_late_can_bus(
    const LateBus& late, const std::function<Result<std::unique_ptr<CanBus>>()>& open);

}  // namespace cairn
