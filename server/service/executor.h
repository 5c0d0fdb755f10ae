// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "common/base/time.h"

namespace cairn {

using Task = std::function<void()>;

/// Whether somebody waits for a task with a camera in the hand, or it can stand back for those.
enum class Urgency : uint8_t { kNormal, kUrgent };

/// Runs tasks: on threads in a server (WorkerPool), on the one thread of a simulation. Thread-safe.
class Executor {
 public:
  virtual ~Executor() = default;
  /// Runs the task soon, never within the call. A task that throws is logged and ends alone: no peer's data
  /// may stop the server.
  virtual void submit(Task task, Urgency urgency = Urgency::kNormal) = 0;
  /// Whether an urgent task waits: what runs and can be taken up again should stop.
  [[nodiscard]] virtual bool urgent_waits() const = 0;
  /// Share of its time spent in tasks since the last call (or the start), 0..1.
  [[nodiscard]] virtual float take_load() = 0;
  /// Lets running tasks end, drops those that wait and all that comes. Executors whose tasks submit to each
  /// other are all stopped before any of them is destroyed.
  virtual void stop() = 0;
};

/// Runs the same function again and again, one call at a time: a writer's thread (TurnThread), or the one
/// thread of a simulation. Thread-safe but for begin() and finish().
class Turns {
 public:
  /// When the next turn is due, unless wake() comes before; nothing: only wake() brings one.
  using Turn = std::function<std::optional<MonotonicTime>()>;
  virtual ~Turns() = default;
  /// To be called once, before anything else. The first turn comes soon.
  virtual void begin(Turn turn) = 0;
  /// A turn that begins after this call comes soon.
  virtual void wake() = 0;
  /// Gives all turns that wake() has asked for, those that these ask for included, and none after that.
  virtual void finish() = 0;
};

/// Runs a task on as many threads at a time as there are, this one among them, and waits until all have
/// ended: each does a share of the work.
using Parallel = std::function<void(const Task& share)>;

}  // namespace cairn
