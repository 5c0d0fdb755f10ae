// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "common/base/log.h"

namespace cairn {

/// How long a program that has done its work waits for the network middleware to close.
constexpr std::chrono::seconds kClosingPatience{3};

/// Holds the end of a process to a time, whatever a library's closing does: make it when all files are
/// complete and the exit code is known, then close the rest, then destroy it. When the time is over before
/// that, the process says so and ends with the code, without destructors. What stands in the streams of C is
/// written at construction.
class ExitDeadline {
 public:
  ExitDeadline(int exit_code, std::chrono::milliseconds patience, Logger log);
  ~ExitDeadline();
  ExitDeadline(const ExitDeadline&) = delete;
  ExitDeadline& operator=(const ExitDeadline&) = delete;

 private:
  void watch();

  const int exit_code_;
  const std::chrono::milliseconds patience_;
  const Logger log_;
  std::mutex mutex_;
  std::condition_variable closed_;
  bool is_closed_ = false;
  std::thread thread_;
};

}  // namespace cairn
