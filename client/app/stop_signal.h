// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

namespace cairn {

/// SIGINT, SIGTERM and, without nohup, SIGHUP (stop) and SIGUSR1 (a new map) as questions instead of
/// interruptions; SIGPIPE and SIGXFSZ are ignored from then on. The signals are blocked for the thread that
/// makes the object and all threads begun later, so make it first; the second signal to stop ends the process
/// at once.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  /// Whether a signal to stop has come. Only the thread that made the object may ask.
  [[nodiscard]] bool requested();

  /// Whether a new map was asked for since the last call.
  [[nodiscard]] bool new_map_requested();

 private:
  sigset_t signals_{};
  sigset_t new_map_signal_{};
  sigset_t mask_before_{};
  bool requested_ = false;
};

}  // namespace cairn
