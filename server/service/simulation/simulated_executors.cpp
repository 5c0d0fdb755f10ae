// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/simulated_executors.h"

#include <algorithm>
#include <utility>

namespace cairn::simulation {

void SimulatedExecutor::submit(Task task, Urgency urgency) {
  if (stopped_) return;
  (urgency == Urgency::kUrgent ? urgent_ : normal_).push_back(std::move(task));
}

void SimulatedExecutor::stop() {
  stopped_ = true;
  const std::deque<Task> dropped_urgent = std::exchange(urgent_, {});
  const std::deque<Task> dropped = std::exchange(normal_, {});
}

void SimulatedExecutor::run_one(Random& random) {
  std::deque<Task>& tasks = urgent_.empty() ? normal_ : urgent_;
  const auto chosen =
      tasks.begin() + static_cast<std::ptrdiff_t>(draw(random, std::min(workers_, tasks.size())));
  const Task task = std::move(*chosen);
  tasks.erase(chosen);
  task();
}

void WriterTurns::finish() {
  while (is_woken_ && !is_cut_) take_turn();
}

void WriterTurns::take_turn() {
  is_woken_ = false;
  next_ = turn_();
}

}  // namespace cairn::simulation
