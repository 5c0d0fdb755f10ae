// SPDX-License-Identifier: Apache-2.0
#include "hw/app/doctor.h"

#include <algorithm>
#include <cstdio>
#include <vector>

#include "common/base/log.h"
#include "hw/app/examination.h"
#include "hw/app/scaled_clock.h"
#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

constexpr std::chrono::seconds kListening{1};

void print(const std::vector<Check>& checks) {
  for (const Check& check : checks)
    std::printf("%s %s\n", check.passed ? "ok    " : "FAILED", check.what.c_str());
  std::fflush(stdout);
}

bool all_passed(const std::vector<Check>& checks) {
  return std::all_of(checks.begin(), checks.end(), [](const Check& check) { return check.passed; });
}

}  // namespace

int run_doctor(const RigOptions& options, const RigConfiguration& configuration) {
  const auto facts = ask_interface(options.can);
  const std::vector<Check> of_interface = check_interface(options.can, facts);
  print(of_interface);
  if (!facts || !facts->is_can || !facts->is_up) {
    std::fprintf(stderr, "cairn-rig: the bus cannot be listened to; what follows on it is not checked\n");
    return 1;
  }
  auto bus = open_can_bus(options.can);
  if (!bus) {
    say_error("cairn-rig", bus.error().message);
    return exit_code(bus.error().code);
  }
  Examination examination(configuration);
  const ScaledClock clock(options.time_scale);
  const MonotonicTime start = clock.now();
  const auto deadline = std::chrono::steady_clock::now() + kListening * options.time_scale;
  while (const auto frame = receive_until(**bus, deadline)) examination.receive(frame->frame);
  std::vector<Check> of_bus = examination.conclude(clock.now() - start, facts->bit_rate);
  if (const std::string trouble = describe((*bus)->health(), options.can); !trouble.empty())
    of_bus.insert(of_bus.begin(), {false, trouble});
  print(of_bus);
  return all_passed(of_interface) && all_passed(of_bus) ? 0 : 1;
}

}  // namespace cairn
