// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "common/base/log.h"

namespace cairn {

using Task = std::function<void()>;

/// Threads that run tasks in the order of submission. Two pools make the two lanes of the server: one at
/// normal priority for what a tracker waits for, one with a nice value for global adjustments, so that these
/// give way at once. Thread-safe.
class WorkerPool {
 public:
  /// `nice_value` is added to the priority of the threads (0..19, larger is lower).
  WorkerPool(int threads, int nice_value, Logger log);
  ~WorkerPool() { stop(); }
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// A task that throws is logged and ends alone: no peer's data may stop the server. Dropped after stop().
  void submit(Task task);
  /// Lets running tasks end, drops those that wait, ends the threads. Pools whose tasks submit to each other
  /// are all stopped before any of them is destroyed.
  void stop();

  /// Share of thread time spent in tasks since the last call (or the start), 0..1.
  [[nodiscard]] float take_load();

 private:
  void run(int nice_value);

  Logger log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Task> tasks_;
  bool stopping_ = false;
  std::atomic<int64_t> busy_ns_{0};
  std::chrono::steady_clock::time_point load_since_;
  std::vector<std::thread> threads_;
};

}  // namespace cairn
