// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/strangers.h"

#include <utility>

namespace cairn {

void Strangers::came(uint64_t participant, std::string says, MonotonicTime now) {
  if (waiting_.size() < kMost && !let_in_.contains(participant))
    waiting_.try_emplace(participant, Stranger{std::move(says), now});
}

void Strangers::gone(uint64_t participant) {
  let_in_.erase(participant);
  auto known = waiting_.extract(participant);
  if (known && left_.size() < kMost)
    left_.push_back({std::move(known.mapped().says), true, known.mapped().came});
}

std::vector<Strangers::Told> Strangers::take(MonotonicTime now) {
  std::vector<Told> told = std::exchange(left_, {});
  for (auto it = waiting_.begin(); it != waiting_.end();) {
    if (now - it->second.came < kPatience) {
      ++it;
    } else {
      told.push_back({std::move(it->second.says), false, it->second.came});
      it = waiting_.erase(it);
    }
  }
  return told;
}

}  // namespace cairn
