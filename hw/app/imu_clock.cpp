// SPDX-License-Identifier: Apache-2.0
#include "hw/app/imu_clock.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr int64_t kTick = 100'000;          // [ns]
constexpr int64_t kSecond = 1'000'000'000;  // [ns]

}  // namespace

void ImuClock::receive(uint32_t ticks, Timestamp received) {
  const int32_t passed = ticks_ ? static_cast<int32_t>(ticks - *ticks_) : 0;
  ticks_ = ticks;
  if (passed < 0) {  // it began anew
    *this = ImuClock();
    ticks_ = ticks;
  }
  own_time_ = least_ ? own_time_ + passed * kTick : int64_t{ticks} * kTick;
  const int64_t offset = received.nanoseconds - own_time_;
  if (!least_ || own_time_ - begin_ > kSecond) {
    least_before_ = least_;
    least_ = offset;
    begin_ = own_time_;
  }
  least_ = std::min(*least_, offset);
}

std::optional<int64_t> ImuClock::offset() const {
  if (!least_ || !least_before_) return least_;
  return std::min(*least_, *least_before_);
}

}  // namespace cairn
