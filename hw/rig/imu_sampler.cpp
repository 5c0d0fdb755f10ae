// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/imu_sampler.h"

namespace cairn {
namespace {

constexpr double kTick = 1e-4;      // [s]
constexpr int32_t kLongest = 5000;  // [ticks]: after a longer gap nobody knows what was between

Eigen::Vector3d vector(const std::array<double, 3>& parts) {
  return Eigen::Vector3d(parts[0], parts[1], parts[2]);
}

}  // namespace

std::optional<ImuSample> ImuSampler::receive(const xsens::Message& message) {
  if (const auto* time = std::get_if<xsens::SampleTime>(&message)) {
    ticks_ = time->ticks;
    rate_.reset();
  }
  if (const auto* rate = std::get_if<xsens::RateOfTurn>(&message)) rate_ = vector(rate->rate);
  const auto* acceleration = std::get_if<xsens::Acceleration>(&message);
  if (acceleration == nullptr || !ticks_ || !rate_) return std::nullopt;
  const auto passed = last_ ? static_cast<int32_t>(*ticks_ - *last_) : 0;
  last_ = ticks_;
  const bool known = passed > 0 && passed <= kLongest;
  const ImuSample sample{known ? passed * kTick : 0, *rate_, vector(acceleration->acceleration)};
  ticks_.reset();
  rate_.reset();
  return sample;
}

}  // namespace cairn
