// SPDX-License-Identifier: Apache-2.0
#include "server/service/worker_pool.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <exception>
#include <future>
#include <utility>

namespace cairn {

using std::chrono::steady_clock;

WorkerPool::WorkerPool(int threads, int nice_value, Logger log)
    : log_(std::move(log)), load_since_(steady_clock::now()) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this, nice_value] { run(nice_value); });
}

void WorkerPool::stop() {
  std::deque<Task> dropped_urgent;  // what they hold goes outside the lock
  std::deque<Task> dropped;
  {
    const std::scoped_lock lock(mutex_);
    if (stopping_) return;
    dropped_urgent.swap(urgent_);
    dropped.swap(normal_);
    urgent_waiting_ = 0;
  }
  finish();
}

void WorkerPool::finish() {
  {
    const std::scoped_lock lock(mutex_);
    if (std::exchange(stopping_, true)) return;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerPool::submit(Task task, Urgency urgency) {
  {
    const std::scoped_lock lock(mutex_);
    if (stopping_) return;
    (urgency == Urgency::kUrgent ? urgent_ : normal_).push_back(std::move(task));
    urgent_waiting_ = urgent_.size();
  }
  wake_.notify_one();
}

float WorkerPool::take_load() {
  const auto now = steady_clock::now();
  const std::chrono::nanoseconds passed = now - std::exchange(load_since_, now);
  const double capacity = static_cast<double>(passed.count()) * static_cast<double>(threads_.size());
  const auto busy = static_cast<double>(busy_ns_.exchange(0));
  return capacity > 0 ? static_cast<float>(std::clamp(busy / capacity, 0.0, 1.0)) : 0.0F;
}

void WorkerPool::run(int nice_value) {
  // On Linux a nice value belongs to the thread.
  if (nice_value > 0) setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), nice_value);
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || !urgent_.empty() || !normal_.empty(); });
    if (urgent_.empty() && normal_.empty()) return;  // stopping
    std::deque<Task>& tasks = urgent_.empty() ? normal_ : urgent_;
    Task task = std::move(tasks.front());
    tasks.pop_front();
    urgent_waiting_ = urgent_.size();
    lock.unlock();
    const auto begin = steady_clock::now();
    try {
      task();
    } catch (const std::exception& problem) {
      log_->error("a task of the worker pool failed: {}", problem.what());
    }
    task = nullptr;  // what it holds goes before the next wait, outside the lock
    busy_ns_ += std::chrono::nanoseconds(steady_clock::now() - begin).count();
    lock.lock();
  }
}

Parallel on_threads(int threads) {
  return [threads](const Task& share) {
    std::vector<std::future<void>> helpers;  // which wait for their threads, whatever is thrown
    for (int i = 1; i < threads; ++i) helpers.push_back(std::async(std::launch::async, share));
    share();
    for (std::future<void>& helper : helpers) helper.get();
  };
}

}  // namespace cairn
