// SPDX-License-Identifier: Apache-2.0
#include "hw/app/simulate.h"

#include <poll.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <string>

#include "common/base/log.h"
#include "common/base/utf8.h"
#include "hw/app/scaled_clock.h"
#include "hw/can/socket_bus.h"

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kStep{1};

/// Lines of stdin, without waiting for any.
class Lines {
 public:
  /// One that is there.
  std::optional<std::string> next() {
    read_more();
    const size_t end = text_.find('\n');
    if (end == std::string::npos) return std::nullopt;
    std::string line = text_.substr(0, end);
    text_.erase(0, end + 1);
    return line;
  }

 private:
  void read_more() {
    pollfd ready{STDIN_FILENO, POLLIN, 0};
    while (!ended_ && poll(&ready, 1, 0) == 1) {
      std::array<char, 256> piece{};
      const ssize_t size = read(STDIN_FILENO, piece.data(), piece.size());
      if (size <= 0 || text_.size() > kMost) ended_ = true;
      if (size > 0) text_.append(piece.data(), static_cast<size_t>(size));
    }
  }
  static constexpr size_t kMost = 4096;
  std::string text_;
  bool ended_ = false;
};

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
  Lines lines;
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
