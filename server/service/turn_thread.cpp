// SPDX-License-Identifier: Apache-2.0
#include "server/service/turn_thread.h"

#include <utility>

namespace cairn {

void TurnThread::begin(Turn turn) {
  thread_ = std::thread([this, turn = std::move(turn)] { run(turn); });
}

void TurnThread::wake() {
  {
    const std::scoped_lock lock(mutex_);
    is_woken_ = true;
  }
  wake_.notify_one();
}

void TurnThread::finish() {
  {
    const std::scoped_lock lock(mutex_);
    finishing_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) thread_.join();
}

void TurnThread::run(const Turn& turn) {
  const auto has_work = [this] { return is_woken_ || finishing_; };
  std::optional<MonotonicTime> next;
  std::unique_lock lock(mutex_);
  while (true) {
    if (next) {
      wake_.wait_until(lock, *next, has_work);
    } else {
      wake_.wait(lock, has_work);
    }
    if (!std::exchange(is_woken_, false) && finishing_) return;
    lock.unlock();
    next = turn();
    lock.lock();
  }
}

}  // namespace cairn
