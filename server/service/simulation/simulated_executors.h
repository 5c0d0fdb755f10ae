// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <random>
#include <string>
#include <vector>

#include "server/service/clock.h"
#include "server/service/executor.h"

/// The threads of a server, as the one thread of a simulation has them: what would run is chosen by a seed.
namespace cairn::simulation {

using Random = std::mt19937_64;

/// 0..n-1.
[[nodiscard]] inline size_t draw(Random& random, size_t n) {
  return static_cast<size_t>(random() % n);
}
[[nodiscard]] inline bool chance(Random& random, double probability) {
  return static_cast<double>(random() >> 11) * 0x1p-53 < probability;
}

/// Stands still unless it is set forward.
class FakeClock : public Clock {
 public:
  [[nodiscard]] MonotonicTime now() const override { return now_; }
  [[nodiscard]] Timestamp wall() const override {
    return Timestamp{kBegin} + std::chrono::nanoseconds(now_.time_since_epoch());
  }
  void advance(std::chrono::nanoseconds by) { now_ += by; }

 private:
  static constexpr int64_t kBegin = 1'767'225'600'000'000'000;  ///< some day
  MonotonicTime now_{std::chrono::hours(1)};
};

/// What a pool of `workers` threads would run. As with those, urgent tasks are begun first and in order, and
/// of those that run beside each other any may come to its end first.
class SimulatedExecutor : public Executor {
 public:
  explicit SimulatedExecutor(size_t workers) : workers_(workers) {}

  void submit(Task task, Urgency urgency = Urgency::kNormal) override;
  [[nodiscard]] bool urgent_waits() const override { return !urgent_.empty(); }
  [[nodiscard]] float take_load() override { return 0; }
  void stop() override;

  [[nodiscard]] bool has_task() const { return !urgent_.empty() || !normal_.empty(); }
  void run_one(Random& random);

 private:
  const size_t workers_;
  std::deque<Task> urgent_;
  std::deque<Task> normal_;
  bool stopped_ = false;
};

/// The thread of the store's writer.
class WriterTurns : public Turns {
 public:
  void begin(Turn turn) override { turn_ = std::move(turn); }
  void wake() override { is_woken_ = true; }
  void finish() override;
  /// The process has gone: nothing more is done, by finish() either.
  void cut() { is_cut_ = true; }

  [[nodiscard]] bool is_due(MonotonicTime now) const { return is_woken_ || (next_ && *next_ <= now); }
  void take_turn();

 private:
  Turn turn_;
  std::optional<MonotonicTime> next_;
  bool is_woken_ = true;
  bool is_cut_ = false;
};

}  // namespace cairn::simulation
