// SPDX-License-Identifier: Apache-2.0
#include "server/service/strand.h"

#include <utility>

namespace cairn {

void Strand::ask_for_turn(const std::shared_ptr<State>& state, bool urgent) {
  state->pool.submit([state] { run_one(state); }, urgent ? Urgency::kUrgent : Urgency::kNormal);
}

void Strand::post(Task task, Urgency urgency) {
  const bool urgent = urgency == Urgency::kUrgent;
  {
    const std::scoped_lock lock(state_->mutex);
    if (state_->closed) return;
    state_->tasks.push_back({std::move(task), urgency});
    if (urgent) ++state_->urgent;
    // What runs asks for the next turn when it ends. A queue that has asked for a normal one asks for an
    // urgent one besides when it becomes urgent.
    const bool first = state_->tasks.size() == 1;
    if (state_->running || !(first || (urgent && state_->urgent == 1))) return;
  }
  ask_for_turn(state_, urgent);
}

void Strand::close() {
  std::deque<Waiting> dropped;
  const std::scoped_lock lock(state_->mutex);
  state_->closed = true;
  state_->urgent = 0;
  dropped.swap(state_->tasks);
}

void Strand::run_one(const std::shared_ptr<State>& state) {
  Task task;
  {
    const std::scoped_lock lock(state->mutex);
    if (state->running || state->tasks.empty()) return;  // another turn was first, or closed meanwhile
    state->running = true;
    task = std::move(state->tasks.front().task);
    if (state->tasks.front().urgency == Urgency::kUrgent) --state->urgent;
    state->tasks.pop_front();
  }
  // The next task goes to the pool even if this one throws: a queue must not die of one bad task.
  struct PassOn {
    const std::shared_ptr<State>& state;
    ~PassOn() {
      const std::scoped_lock lock(state->mutex);
      state->running = false;
      if (!state->tasks.empty()) ask_for_turn(state, state->urgent > 0);
    }
  } const pass_on{state};
  task();
  task = nullptr;  // what it holds goes before the next task runs
}

}  // namespace cairn
