// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/head_history.h"

#include <algorithm>

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kKept{1000};
constexpr milliseconds kAhead{20};  // so long the newest one is taken for the present

}  // namespace

void HeadHistory::add(MonotonicTime when, const Eigen::Quaterniond& world_from_head) {
  if (!entries_.empty() && when <= entries_.back().when) entries_.clear();
  entries_.push_back({when, world_from_head});
  while (entries_.front().when + kKept < when) entries_.pop_front();
}

std::optional<Eigen::Quaterniond> HeadHistory::at(MonotonicTime when) const {
  const auto after =
      std::lower_bound(entries_.begin(), entries_.end(), when,
                       [](const Entry& entry, MonotonicTime time) { return entry.when < time; });
  if (after == entries_.end()) {
    if (entries_.empty() || when > entries_.back().when + kAhead) return std::nullopt;
    return entries_.back().world_from_head;
  }
  if (after->when == when) return after->world_from_head;
  if (after == entries_.begin()) return std::nullopt;
  const auto before = std::prev(after);
  const double share = std::chrono::duration<double>(when - before->when) / (after->when - before->when);
  return before->world_from_head.slerp(share, after->world_from_head);
}

}  // namespace cairn
