// SPDX-License-Identifier: Apache-2.0
#include "server/store/epochs.h"

#include <algorithm>
#include <iterator>
#include <limits>

namespace cairn {

std::optional<EpochRecord> ids_in_common(std::span<const EpochRecord> epochs, Epoch earlier, Epoch present) {
  constexpr size_t kAll = std::numeric_limits<size_t>::max();
  if (earlier == present) return EpochRecord{present, kAll, kAll};
  const auto then =
      std::find_if(epochs.begin(), epochs.end(), [&](const EpochRecord& e) { return e.epoch == earlier; });
  if (then == epochs.end() || std::next(then) == epochs.end()) return std::nullopt;
  // What an epoch began with was all that was left of those before it: after a roll-back, less than that with
  // which an earlier one had begun.
  EpochRecord left = *std::next(then);
  for (auto later = std::next(then); later != epochs.end(); ++later) {
    left.keyframes = std::min(left.keyframes, later->keyframes);
    left.points = std::min(left.points, later->points);
  }
  return left;
}

}  // namespace cairn
