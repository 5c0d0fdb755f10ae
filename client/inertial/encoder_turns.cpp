// SPDX-License-Identifier: Apache-2.0
#include "client/inertial/encoder_turns.h"

#include <algorithm>
#include <iterator>

namespace cairn {
void EncoderTurns::add(std::span<const EncoderSample> samples) {
  for (const EncoderSample& sample : samples) {
    if (!samples_.empty() && sample.time <= samples_.back().time) samples_.clear();
    samples_.push_back(sample);
  }
  // Half of it at a time, so that it is moved seldom.
  if (samples_.size() > 2 * options_.kept)
    samples_.erase(samples_.begin(), samples_.end() - static_cast<std::ptrdiff_t>(options_.kept));
}

std::optional<Eigen::Quaterniond> EncoderTurns::at(Timestamp time) const {
  const auto after =
      std::lower_bound(samples_.begin(), samples_.end(), time,
                       [](const EncoderSample& sample, Timestamp wanted) { return sample.time < wanted; });
  if (after == samples_.end()) {
    if (samples_.empty() || seconds_between(time, samples_.back().time) > options_.most_ahead)
      return std::nullopt;
    return samples_.back().base_from_camera;
  }
  if (after->time == time) return after->base_from_camera;
  if (after == samples_.begin()) return std::nullopt;
  const EncoderSample& before = *std::prev(after);
  const double gap = seconds_between(after->time, before.time);
  if (gap > options_.most_gap) return std::nullopt;
  return before.base_from_camera.slerp(seconds_between(time, before.time) / gap, after->base_from_camera);
}

std::optional<Eigen::Quaterniond> EncoderTurns::turn(Timestamp from, Timestamp to) const {
  const auto before = at(from);
  const auto now = at(to);
  if (!before || !now) return std::nullopt;
  return now->conjugate() * *before;
}

}  // namespace cairn
