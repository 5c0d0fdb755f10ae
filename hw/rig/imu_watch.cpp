// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/imu_watch.h"

#include <cmath>
#include <utility>

namespace cairn {
namespace {

constexpr double kTick = 1e-4;         // [s]
constexpr int32_t kSpan = 5000;        // [ticks] over which the counter tells a rate to a thousandth
constexpr int32_t kLongest = 100'000;  // [ticks]: after a longer gap the counter may have wrapped

}  // namespace

void ImuWatch::receive(const xsens::Message& message, MonotonicTime now) {
  if (const auto* time = std::get_if<xsens::SampleTime>(&message)) ticks_ = time->ticks;
  if (const auto* counter = std::get_if<xsens::GroupCounter>(&message)) count(counter->count);
  if (std::holds_alternative<xsens::RateOfTurn>(message)) heard_ = now;
}

void ImuWatch::count(uint16_t sample) {
  const auto ticks = std::exchange(ticks_, std::nullopt);
  if (!ticks) return;
  const Mark mark{*ticks, sample};
  if (!begin_) begin_ = mark;
  const auto passed = static_cast<int32_t>(mark.ticks - begin_->ticks);
  if (passed < 0 || passed > kLongest) {  // its clock began anew
    begin_ = mark;
  } else if (passed >= kSpan) {
    measured_ = static_cast<uint16_t>(mark.count - begin_->count) / (passed * kTick);
    begin_ = mark;
  }
}

bool ImuWatch::is_at_wrong_rate() const {
  return measured_ && std::abs(*measured_ / rate_ - 1) > rate_off_;
}

}  // namespace cairn
