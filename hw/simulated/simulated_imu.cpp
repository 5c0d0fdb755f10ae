// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/simulated_imu.h"

namespace cairn::simulated {
namespace {

constexpr std::chrono::microseconds kTick{100};

/// `value` with noise of that standard deviation on each part.
std::array<double, 3> noisy(std::array<double, 3> value, double deviation, std::mt19937& random) {
  std::normal_distribution<double> noise(0, 1);
  for (double& part : value) part += deviation * noise(random);
  return value;
}

std::array<double, 3> sum(std::array<double, 3> a, const std::array<double, 3>& b) {
  for (size_t i = 0; i < a.size(); ++i) a.at(i) += b.at(i);
  return a;
}

std::array<double, 3> scaled(std::array<double, 3> value, double factor) {
  for (double& part : value) part *= factor;
  return value;
}

}  // namespace

SimulatedImu::SimulatedImu(const ImuOptions& options, uint32_t seed, MonotonicTime now)
    : options_(options), random_(seed), start_(now) {
  set_frequency(options.frequency);
  began_ = integrated_ = now;
  next_ = now + std::chrono::nanoseconds(static_cast<int64_t>(random_()) % period_.count() + 1);
  rate_bias_ = noisy({}, options.rate_bias, random_);
  acceleration_bias_ = noisy({}, options.acceleration_bias, random_);
}

void SimulatedImu::set_frequency(double frequency) {
  period_ = std::chrono::nanoseconds(static_cast<int64_t>(1e9 / frequency));
}

void SimulatedImu::advance(MonotonicTime now, std::vector<CanFrame>& out) {
  for (; next_ <= now; next_ += period_) sample(out);
  integrate(now);
}

void SimulatedImu::integrate(MonotonicTime until) {
  const double time = std::chrono::duration<double>(until - integrated_).count();
  integral_.rate = sum(integral_.rate, scaled(motion_.rate, time));
  integral_.acceleration = sum(integral_.acceleration, scaled(motion_.acceleration, time));
  integrated_ = until;
}

void SimulatedImu::sample(std::vector<CanFrame>& out) {
  integrate(next_);
  const double share = 1 / std::chrono::duration<double>(next_ - began_).count();
  const ImuMotion mean{scaled(integral_.rate, share), scaled(integral_.acceleration, share)};
  integral_ = {{}, {}};
  began_ = next_;
  const xsens::RateOfTurn rate{noisy(sum(mean.rate, rate_bias_), options_.rate_noise, random_)};
  const xsens::Acceleration acceleration{
      noisy(sum(mean.acceleration, acceleration_bias_), options_.acceleration_noise, random_)};
  const auto ticks = static_cast<uint32_t>((next_ - start_) / kTick);
  const uint16_t count = count_++;
  if (muted_) return;
  for (const xsens::Message& message :
       {xsens::Message(xsens::SampleTime{ticks}), xsens::Message(xsens::GroupCounter{count}),
        xsens::Message(rate), xsens::Message(acceleration)}) {
    if (const auto frame = xsens::encode(message, options_.ids)) out.push_back(*frame);
  }
}

}  // namespace cairn::simulated
