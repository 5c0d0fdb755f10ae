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

/// Whether somebody waits for a task with a camera in the hand, or it can stand back for those.
enum class Urgency : uint8_t { kNormal, kUrgent };

/// Threads that run tasks, urgent ones first, in the order of submission. Two pools make the two lanes of the
/// server: one at normal priority for what a tracker waits for, one with a nice value for global adjustments,
/// so that these give way at once. Thread-safe.
class WorkerPool {
 public:
  /// `nice_value` is added to the priority of the threads (0..19, larger is lower).
  WorkerPool(int threads, int nice_value, Logger log);
  ~WorkerPool() { stop(); }
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// A task that throws is logged and ends alone: no peer's data may stop the server. Dropped after stop().
  void submit(Task task, Urgency urgency = Urgency::kNormal);
  /// Whether an urgent task waits for a thread: what runs and can be taken up again should stop.
  [[nodiscard]] bool urgent_waits() const { return urgent_waiting_.load(std::memory_order_relaxed) > 0; }
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
  std::deque<Task> urgent_;
  std::deque<Task> normal_;
  bool stopping_ = false;
  std::atomic<size_t> urgent_waiting_{0};  ///< urgent_.size(), to be read without the lock
  std::atomic<int64_t> busy_ns_{0};
  std::chrono::steady_clock::time_point load_since_;
  std::vector<std::thread> threads_;
};

}  // namespace cairn
