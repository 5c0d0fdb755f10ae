// SPDX-License-Identifier: Apache-2.0
#include "server/service/held_strand.h"

#include <utility>

namespace cairn {

void HeldStrand::submit(Task task) {
  hold([task = std::move(task)](const Hold&) { task(); });
}

void HeldStrand::hold(std::function<void(Hold hold)> then) {
  {
    const std::scoped_lock lock(mutex_);
    if (is_stopped_) return;
    waiting_.push_back(std::move(then));
  }
  begin_next();
}

void HeldStrand::submit_within(const Hold& hold, Task task) {
  executor_->submit([hold, task = std::move(task)] { task(); });
}

void HeldStrand::stop() {
  std::deque<std::function<void(Hold hold)>>
      dropped;  // outside of the lock: what they hold may come back here
  {
    const std::scoped_lock lock(mutex_);
    is_stopped_ = true;
    dropped.swap(waiting_);
  }
  executor_->stop();
}

void HeldStrand::begin_next() {
  std::function<void(Hold hold)> next;
  {
    const std::scoped_lock lock(mutex_);
    if (is_busy_ || waiting_.empty()) return;
    is_busy_ = true;
    next = std::move(waiting_.front());
    waiting_.pop_front();
  }
  executor_->submit([self = shared_from_this(), next = std::move(next)] {
    next(Hold(nullptr, [self](const void*) { self->end(); }));
  });
}

void HeldStrand::end() {
  {
    const std::scoped_lock lock(mutex_);
    is_busy_ = false;
  }
  begin_next();
}

}  // namespace cairn
