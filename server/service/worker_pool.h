// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>
#include <vector>

#include "common/base/log.h"
#include "server/service/executor.h"

namespace cairn {

/// Threads that run tasks, urgent ones first, in the order of submission. Each executor of the server is one
/// (README.md, Threads): at normal priority for what a tracker or a change of rights waits for, with a nice
/// value for the rest, so that it gives way at once. Thread-safe.
class WorkerPool : public Executor {
 public:
  /// `nice_value` is added to the priority of the threads (0..19, larger is lower).
  WorkerPool(int threads, int nice_value, Logger log);
  ~WorkerPool() override { stop(); }
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  void submit(Task task, Urgency urgency = Urgency::kNormal) override;
  [[nodiscard]] bool urgent_waits() const override {
    return urgent_waiting_.load(std::memory_order_relaxed) > 0;
  }
  /// Ends the threads, too.
  void stop() override;
  /// Ends the threads when all that waits has been done. Nothing more is taken.
  void finish();

  [[nodiscard]] float take_load() override;

 private:
  void run(int nice_value);

  Logger log_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<Task> urgent_;
  std::deque<Task> normal_;
  bool stopping_ = false;
  std::atomic<size_t> urgent_waiting_{0};  ///< urgent_.size(), to be read without the lock
  std::atomic<int64_t> busy_ns_{0};
  std::chrono::steady_clock::time_point load_since_;
  std::vector<std::thread> threads_;
};

/// A Parallel on so many threads, which live no longer than a call.
[[nodiscard]] Parallel on_threads(int threads);

}  // namespace cairn
