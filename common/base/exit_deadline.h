// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "common/base/log.h"

namespace cairn {

/// How long a program that has done its work waits for the network middleware to close.
constexpr std::chrono::seconds kClosingPatience{3};

/// What a process is begun with.
struct Command {
  std::string program;                 ///< path
  std::vector<std::string> arguments;  ///< from the program's own name on
};

/// This program with the arguments that it was begun with; without any where /proc does not tell.
[[nodiscard]] Command own_command();

/// Holds the end of a process to a time, whatever a library's closing does: make it when all files are
/// complete and what follows is known, then close the rest, then destroy it. When the time is over before
/// that, the process says so and goes without destructors. What stands in the streams of C is written at
/// construction.
class ExitDeadline {
 public:
  /// When the time is over, the process ends with the code.
  ExitDeadline(int exit_code, std::chrono::milliseconds patience, Logger log);
  /// When the time is over, the process becomes `next`, under its process id and with its standard streams
  /// alone. Where that cannot be, it ends with kInternal's code.
  ExitDeadline(Command next, std::chrono::milliseconds patience, Logger log);
  ~ExitDeadline();
  ExitDeadline(const ExitDeadline&) = delete;
  ExitDeadline& operator=(const ExitDeadline&) = delete;

 private:
  void watch();

  const int exit_code_;
  const Command next_;  ///< without arguments: none
  const std::chrono::milliseconds patience_;
  const Logger log_;
  std::mutex mutex_;
  std::condition_variable closed_;
  bool is_closed_ = false;
  std::thread thread_;
};

}  // namespace cairn
