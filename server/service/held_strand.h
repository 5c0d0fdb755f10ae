// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <mutex>

#include "server/service/executor.h"

namespace cairn {

/// Tasks one after another on an executor. One can hold the strand beyond its end: who needs it for work that
/// others bring about first waits for the strand before he asks them to, not after. Thread-safe.
class HeldStrand : public std::enable_shared_from_this<HeldStrand> {
 public:
  /// While any copy of it lives, no other task begins.
  using Hold = std::shared_ptr<const void>;

  explicit HeldStrand(std::unique_ptr<Executor> executor) : executor_(std::move(executor)) {}
  void submit(Task task);
  /// Calls `then` on the executor, in its turn.
  void hold(std::function<void(Hold hold)> then);
  /// Submits a task of the one who has the hold. It waits for no task of the strand, only for what was
  /// submitted within the hold before.
  void submit_within(const Hold& hold, Task task);
  /// Stops the strand, as Executor::stop() stops an executor.
  void stop();

 private:
  void begin_next();
  void end();

  const std::unique_ptr<Executor> executor_;
  std::mutex mutex_;  ///< of what follows
  std::deque<std::function<void(Hold hold)>> waiting_;
  bool is_busy_ = false;
  bool is_stopped_ = false;
};

}  // namespace cairn
