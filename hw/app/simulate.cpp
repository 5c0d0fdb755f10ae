// SPDX-License-Identifier: Apache-2.0
#include "hw/app/simulate.h"

#include <cstdio>
#include <string>

#include "common/base/log.h"
#include "common/base/utf8.h"
#include "hw/app/input_lines.h"
#include "hw/app/scaled_clock.h"
#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kStep{1};

/// "WHAT" or "WHAT+DURATION": from now on.
void inject(const std::string& line, SimulatedRig* rig, MonotonicTime now) {
  const size_t plus = line.find('+');
  const auto fault =
      parse_timed_fault(line.substr(0, plus) + "@0" + (plus == std::string::npos ? "" : line.substr(plus)));
  if (!fault) return say_error("cairn-rig", fault.error().message);
  rig->inject(fault->what, fault->lasts, now);
}

}  // namespace

int run_simulation(const RigOptions& options, const RigConfiguration& configuration,
                   const sigset_t& signals) {
  auto bus = open_can_bus(options.can);
  if (!bus) {
    say_error("cairn-rig", bus.error().message);
    return exit_code(bus.error().code);
  }
  const ScaledClock clock(options.time_scale);
  SimulatedRig rig(configuration, options.faults, options.seed, clock.now(), [](const std::string& line) {
    std::printf("%s\n", line.c_str());
    std::fflush(stdout);
  });
  InputLines lines;
  std::string trouble;
  const auto step = std::chrono::duration_cast<std::chrono::nanoseconds>(kStep) * options.time_scale;
  const timespec wait{step.count() / 1'000'000'000, step.count() % 1'000'000'000};
  while (sigtimedwait(&signals, nullptr, &wait) < 0) {
    while (const auto line = lines.next()) inject(*line, &rig, clock.now());
    rig.turn(**bus, clock.now());
    std::string now = describe((*bus)->health(), options.can);
    if (now != trouble && !now.empty()) say_error("cairn-rig", now);
    trouble = std::move(now);
  }
  rig.tell_extremes();
  return 0;
}

}  // namespace cairn
