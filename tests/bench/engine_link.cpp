// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/engine_link.h"

#include "tests/bench/timing.h"

namespace cairn {

void EngineLink::use_map(MapId map, Epoch /*epoch*/, Revision /*revision*/) {
  if (const IndexedMap* known = index_.find(map)) held_ = known->snapshot;
}

bool EngineLink::wait_until_settled(std::chrono::milliseconds /*timeout*/) {
  if (const auto view = std::exchange(asked_, nullptr)) {
    const double before = thread_cpu_ms();
    answer_ = relocalize(index_, *camera_, *view, options_);
    answer_ms_.push_back(thread_cpu_ms() - before);
  }
  return true;
}

}  // namespace cairn
