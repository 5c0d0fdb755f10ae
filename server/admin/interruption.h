// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <csignal>

namespace cairn {

/// While it lives, the first SIGINT, SIGTERM or (without nohup) SIGHUP does not end the process, but is kept
/// here as a question; the second ends it at once. One object at a time.
class Interruption {
 public:
  Interruption();
  ~Interruption();
  Interruption(const Interruption&) = delete;
  Interruption& operator=(const Interruption&) = delete;

  /// Whether such a signal has come, in the life of any object. Any thread.
  [[nodiscard]] static bool requested();

 private:
  static constexpr std::array kSignals = {SIGINT, SIGTERM, SIGHUP};
  std::array<struct sigaction, kSignals.size()> before_{};
};

}  // namespace cairn
