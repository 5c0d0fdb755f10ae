// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <utility>

#include "server/service/executor.h"

namespace cairn {

/// Tasks that wait until a test runs them.
struct TasksByHand {
  std::deque<Task> urgent;
  std::deque<Task> normal;

  [[nodiscard]] bool empty() const { return urgent.empty() && normal.empty(); }
  void run_one() {
    std::deque<Task>& tasks = urgent.empty() ? normal : urgent;
    const Task task = std::move(tasks.front());
    tasks.pop_front();
    task();
  }
};

/// An executor that runs nothing by itself. `tasks` outlive it.
class ByHand : public Executor {
 public:
  explicit ByHand(TasksByHand* tasks) : tasks_(*tasks) {}
  void submit(Task task, Urgency urgency = Urgency::kNormal) override {
    (urgency == Urgency::kUrgent ? tasks_.urgent : tasks_.normal).push_back(std::move(task));
  }
  [[nodiscard]] bool urgent_waits() const override { return !tasks_.urgent.empty(); }
  [[nodiscard]] float take_load() override { return 0; }
  void stop() override { std::exchange(tasks_, {}); }

 private:
  TasksByHand& tasks_;
};

}  // namespace cairn
