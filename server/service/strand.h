// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <memory>
#include <mutex>

#include "server/service/executor.h"

namespace cairn {

/// Runs tasks one at a time, in the order they were posted, on a pool: the one writer of a map. Queues of one
/// pool take turns, task by task; one in which an urgent task waits is urgent until that has run. Each task
/// sees all that the tasks before it wrote. Thread-safe.
class Strand {
 public:
  explicit Strand(Executor& pool) : state_(std::make_shared<State>(pool)) {}

  /// Tasks may post to their own queue. What is posted outlives this handle until it has run or the queue is
  /// closed; dropped once that has happened.
  void post(Task task, Urgency urgency = Urgency::kNormal);
  /// Drops the tasks that wait: they may hold what holds this queue. One that runs goes on.
  void close();

 private:
  struct Waiting {
    Task task;
    Urgency urgency;
  };
  struct State {
    explicit State(Executor& p) : pool(p) {}
    Executor& pool;
    std::mutex mutex;
    std::deque<Waiting> tasks;
    size_t urgent = 0;     ///< of `tasks`
    bool running = false;  ///< a task is being run
    bool closed = false;
  };
  /// Asks the pool for a turn. As many as asked for come; one that finds nothing to do is over at once.
  static void ask_for_turn(const std::shared_ptr<State>& state, bool urgent);
  static void run_one(const std::shared_ptr<State>& state);

  std::shared_ptr<State> state_;
};

}  // namespace cairn
