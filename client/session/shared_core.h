// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <type_traits>
#include <utility>

#include "client/session/session_core.h"
#include "common/base/log.h"

namespace cairn {

/// A SessionCore that the frame loop, the receiver and the sender share. The mutex is held for moments only:
/// never while encoding, writing, taking or building snapshots.
class SharedCore {
 public:
  SharedCore(SessionCore core, Logger log) : log_(std::move(log)), core_(std::move(core)) {}

  /// An event: `event(core)`, and then what the core asks for.
  template <typename Event>
  auto apply(Event&& event) {
    if constexpr (std::is_void_v<std::invoke_result_t<Event, SessionCore&>>) {
      perform([&] {
        const std::scoped_lock lock(mutex_);
        std::forward<Event>(event)(core_);
        return core_.take_actions();
      }());
    } else {
      std::unique_lock lock(mutex_);
      auto result = std::forward<Event>(event)(core_);
      const SessionCore::Actions actions = core_.take_actions();
      lock.unlock();
      perform(actions);
      return result;
    }
  }
  /// Returns what `look(core)` returns, with the core locked.
  template <typename Look>
  auto look(Look&& look) const {
    const std::scoped_lock lock(mutex_);
    return std::forward<Look>(look)(core_);
  }
  /// Waits until `condition(core)`, or for so long; whether it holds.
  template <typename Condition>
  [[nodiscard]] bool wait(std::chrono::milliseconds timeout, Condition&& condition) {
    std::unique_lock lock(mutex_);
    return for_waiters_.wait_for(lock, timeout, [&] { return condition(core_); });
  }

  /// The sender's: the next that is to be sent, when it is; nothing: the session's threads are to end.
  [[nodiscard]] std::optional<SessionCore::Outgoing> wait_for_next(
      const std::function<SessionCore::Readers()>& readers);
  /// The threads of a connection are to end, or begin.
  void stop(bool stopping);
  [[nodiscard]] bool is_stopping() const {
    const std::scoped_lock lock(mutex_);
    return stopping_;
  }

 private:
  void perform(const SessionCore::Actions& actions);

  const Logger log_;
  mutable std::mutex mutex_;  ///< of what follows
  SessionCore core_;
  bool stopping_ = false;
  std::condition_variable for_sender_;
  std::condition_variable for_waiters_;
};

}  // namespace cairn
