// SPDX-License-Identifier: Apache-2.0
#include "common/base/exit_deadline.h"

#include <linux/close_range.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <utility>

#include "common/base/result.h"

namespace cairn {
namespace {

/// Returns only where it cannot be.
void become(Command command) {
  std::vector<char*> arguments;
  for (std::string& argument : command.arguments) arguments.push_back(argument.data());
  arguments.push_back(nullptr);
  // Ports and locks that a library still holds would be in the way.
  close_range(STDERR_FILENO + 1, ~0U, CLOSE_RANGE_CLOEXEC);
  execv(command.program.c_str(), arguments.data());
}

}  // namespace

Command own_command() {
  Command command{"/proc/self/exe", {}};
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  for (std::string argument; std::getline(file, argument, '\0');) command.arguments.push_back(argument);
  return command;
}

ExitDeadline::ExitDeadline(int exit_code, std::chrono::milliseconds patience, Logger log)
    : exit_code_(exit_code), patience_(patience), log_(std::move(log)) {
  std::fflush(nullptr);
  thread_ = std::thread([this] { watch(); });
}

ExitDeadline::ExitDeadline(Command next, std::chrono::milliseconds patience, Logger log)
    : exit_code_(cairn::exit_code(ErrorCode::kInternal)),
      next_(std::move(next)),
      patience_(patience),
      log_(std::move(log)) {
  std::fflush(nullptr);
  thread_ = std::thread([this] { watch(); });
}

ExitDeadline::~ExitDeadline() {
  {
    const std::scoped_lock lock(mutex_);
    is_closed_ = true;
  }
  closed_.notify_one();
  thread_.join();
}

void ExitDeadline::watch() {
  std::unique_lock lock(mutex_);
  if (closed_.wait_for(lock, patience_, [this] { return is_closed_; })) return;
  const bool goes_on = !next_.arguments.empty();
  log_->warn("the network middleware does not close within {} ms: {} without it, nothing is lost",
             patience_.count(), goes_on ? "beginning again" : "ended");
  log_->flush();
  if (goes_on) become(next_);
  _exit(exit_code_);
}

}  // namespace cairn
