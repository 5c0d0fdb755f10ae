// SPDX-License-Identifier: Apache-2.0
#include "client/session/shared_core.h"

namespace cairn {

std::optional<SessionCore::Outgoing> SharedCore::wait_for_next(
    const std::function<SessionCore::Readers()>& readers) {
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    if (auto next = core_.next(std::chrono::steady_clock::now(), readers())) {
      const SessionCore::Actions actions = core_.take_actions();
      lock.unlock();
      perform(actions);
      return next;
    }
    for_sender_.wait_until(lock, core_.next_due());
  }
  return std::nullopt;
}

void SharedCore::stop(bool stopping) {
  {
    const std::scoped_lock lock(mutex_);
    stopping_ = stopping;
  }
  for_sender_.notify_all();
  for_waiters_.notify_all();
}

void SharedCore::perform(const SessionCore::Actions& actions) {
  using Level = SessionCore::Actions::Notice::Level;
  if (actions.look_what_to_send) for_sender_.notify_one();
  if (actions.look_what_changed) for_waiters_.notify_all();
  for (const auto& notice : actions.notices) {
    if (notice.level == Level::kWarning) {
      log_->warn("{}", notice.text);
    } else if (notice.level == Level::kInfo) {
      log_->info("{}", notice.text);
    } else {
      log_->debug("{}", notice.text);
    }
  }
}

}  // namespace cairn
