// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <memory>
#include <mutex>

#include "server/service/worker_pool.h"

namespace cairn {

/// Runs tasks one at a time, in the order they were posted, on a pool: the one writer of a map. Queues of one
/// pool take turns, task by task. Each task sees all that the tasks before it wrote. Thread-safe.
class SerialQueue {
 public:
  explicit SerialQueue(WorkerPool& pool) : state_(std::make_shared<State>(pool)) {}

  /// Tasks may post to their own queue. What is posted outlives this handle until it has run or the queue is
  /// closed; dropped once that has happened.
  void post(Task task) { post(state_, std::move(task)); }
  /// Drops the tasks that wait: they may hold what holds this queue. One that runs goes on.
  void close();

 private:
  struct State {
    explicit State(WorkerPool& p) : pool(p) {}
    WorkerPool& pool;
    std::mutex mutex;
    std::deque<Task> tasks;
    bool running = false;  ///< a task of this queue is with the pool
    bool closed = false;
  };
  static void post(const std::shared_ptr<State>& state, Task task);
  static void run_one(const std::shared_ptr<State>& state);

  std::shared_ptr<State> state_;
};

}  // namespace cairn
