// SPDX-License-Identifier: Apache-2.0
#include "server/endpoint/tries.h"

#include <utility>

namespace cairn {
namespace {

constexpr size_t kMostProcesses = 64;  ///< remembered, of each name

}  // namespace

std::optional<size_t> Tries::note(const std::string& who, const std::optional<wire::PeerId>& process,
                                  MonotonicTime now) {
  const auto [it, is_first] = known_.try_emplace(who);
  Known& known = it->second;
  const bool is_after_pause = is_first || now - std::exchange(known.last, now) >= kPause;
  known.last = now;
  if (known.processes.size() >= kMostProcesses) known.processes.clear();
  const bool is_new = process && known.processes.insert(*process).second;
  const bool is_due = is_after_pause || is_new || now - known.told >= kInterval;
  if (!is_due || !known.limit.take(now)) {
    ++known.untold;
    return std::nullopt;
  }
  known.told = now;
  return std::exchange(known.untold, 0);
}

}  // namespace cairn
