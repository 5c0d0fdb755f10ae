// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/head_history.h"

#include <algorithm>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kKept{1000};
constexpr milliseconds kAhead{20};  // so long the newest one is taken for the present

}  // namespace

void HeadHistory::add(MonotonicTime when, const Head& head) {
  if (!entries_.empty() && when <= entries_.back().when) entries_.clear();
  entries_.push_back({when, head});
  while (entries_.front().when + kKept < when) entries_.pop_front();
}

std::optional<HeadHistory::Head> HeadHistory::at(MonotonicTime when) const {
  const auto after =
      std::lower_bound(entries_.begin(), entries_.end(), when,
                       [](const Entry& entry, MonotonicTime time) { return entry.when < time; });
  if (after == entries_.end()) {
    if (entries_.empty() || when > entries_.back().when + kAhead) return std::nullopt;
    return entries_.back().head;
  }
  if (after->when == when) return after->head;
  if (after == entries_.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const double share = std::chrono::duration<double>(when - before->when) / (after->when - before->when);
  return Head{before->head.world_from_head.slerp(share, after->head.world_from_head),
              (1 - share) * before->head.way + share * after->head.way};
}

}  // namespace cairn
