// SPDX-License-Identifier: Apache-2.0
#include "common/base/exit_deadline.h"

#include <unistd.h>

#include <cstdio>
#include <utility>

namespace cairn {

ExitDeadline::ExitDeadline(int exit_code, std::chrono::milliseconds patience, Logger log)
    : exit_code_(exit_code), patience_(patience), log_(std::move(log)) {
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
  log_->warn("the network middleware does not close within {} ms: ended without it, nothing is lost",
             patience_.count());
  log_->flush();
  _exit(exit_code_);
}

}  // namespace cairn
