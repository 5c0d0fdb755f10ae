// SPDX-License-Identifier: Apache-2.0
#include "server/service/serial_queue.h"

#include <utility>

namespace cairn {

void SerialQueue::post(const std::shared_ptr<State>& state, Task task) {
  {
    const std::scoped_lock lock(state->mutex);
    if (state->closed) return;
    state->tasks.push_back(std::move(task));
    if (std::exchange(state->running, true)) return;
  }
  state->pool.submit([state] { run_one(state); });
}

void SerialQueue::close() {
  std::deque<Task> dropped;
  const std::scoped_lock lock(state_->mutex);
  state_->closed = true;
  dropped.swap(state_->tasks);
}

void SerialQueue::run_one(const std::shared_ptr<State>& state) {
  // The next task goes to the pool even if this one throws: a queue must not die of one bad task.
  struct PassOn {
    const std::shared_ptr<State>& state;
    ~PassOn() {
      const std::scoped_lock lock(state->mutex);
      state->running = !state->tasks.empty();
      if (state->running) state->pool.submit([kept = state] { run_one(kept); });
    }
  } const pass_on{state};
  Task task;
  {
    const std::scoped_lock lock(state->mutex);
    if (state->tasks.empty()) return;  // closed meanwhile
    task = std::move(state->tasks.front());
    state->tasks.pop_front();
  }
  task();
}

}  // namespace cairn
