// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <csignal>

namespace cairn {

/// SIGINT and SIGTERM as a question instead of an interruption. The signals are blocked for the thread that
/// makes the object and all threads begun later, so make it first; the second signal ends the process at
/// once.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  /// Whether a signal has come. To be asked by the thread that made the object.
  [[nodiscard]] bool requested();

 private:
  sigset_t signals_{};
  sigset_t mask_before_{};
  bool requested_ = false;
};

}  // namespace cairn
