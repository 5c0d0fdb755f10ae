// SPDX-License-Identifier: Apache-2.0
#include "server/service/store_threads.h"

#include "server/service/system_clock.h"
#include "server/service/turn_thread.h"
#include "server/service/worker_pool.h"

namespace cairn {
namespace {

constexpr int kStrandNice = 5;     ///< an operator's work gives way to what trackers wait for
constexpr int kExaminerNice = 15;  ///< and nobody stands there and waits for this

}  // namespace

MapPersistence::Runtime store_threads(const Logger& log) {
  return {std::make_shared<SystemClock>(), std::make_unique<TurnThread>("the writer of the store", log),
          std::make_unique<WorkerPool>(1, kStrandNice, log),
          std::make_unique<WorkerPool>(1, kExaminerNice, log)};
}

}  // namespace cairn
