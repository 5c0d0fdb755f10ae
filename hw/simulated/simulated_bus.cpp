// SPDX-License-Identifier: Apache-2.0
#include "hw/simulated/simulated_bus.h"

#include <algorithm>

namespace cairn::simulated {
namespace {

using std::chrono::microseconds;

constexpr microseconds kFrameTime{260};  // 130 bits at 500 kbit/s
constexpr microseconds kStep{1000};

}  // namespace

SimulatedBus::SimulatedBus(const std::vector<DriveOptions>& drives, const ImuOptions& imu, uint32_t seed,
                           MonotonicTime now)
    : random_(seed), start_(now), now_(now), imu_(imu, static_cast<uint32_t>(random_()), now) {
  for (const DriveOptions& options : drives)
    drives_.emplace_back(options, static_cast<uint32_t>(random_()), now);
}

void SimulatedBus::put(const CanFrame& frame, std::deque<OnTheWire>& wire) {
  const MonotonicTime free = wire.empty() ? now_ : std::max(now_, wire.back().arrival);
  wire.push_back({free + kFrameTime, frame});
}

bool SimulatedBus::is_lost() {
  return health_.condition == BusCondition::kBusOff ||
         std::uniform_real_distribution<double>(0, 1)(random_) < dropped_share_;
}

void SimulatedBus::advance(MonotonicTime now) {
  while (now_ < now) {
    now_ = std::min(now, now_ + kStep);
    deliver();
    std::vector<CanFrame> sent;
    for (SimulatedDrive& drive : drives_) drive.advance(now_, sent);
    imu_.advance(now_, sent);
    for (const CanFrame& frame : sent) {
      if (!is_lost()) put(frame, to_host_);
    }
  }
}

void SimulatedBus::deliver() {
  for (; !to_devices_.empty() && to_devices_.front().arrival <= now_; to_devices_.pop_front()) {
    for (SimulatedDrive& drive : drives_) drive.receive(to_devices_.front().frame);
  }
}

void SimulatedBus::set_bus_off(bool off) {
  const bool was_off = health_.condition == BusCondition::kBusOff;
  if (off && !was_off) ++health_.bus_off;
  if (off) to_devices_.clear();
  health_.condition = off ? BusCondition::kBusOff : BusCondition::kUp;
}

SendOutcome SimulatedBus::send(const CanFrame& frame, Urgency) {
  if (!is_valid(frame) || frame.fd) return SendOutcome::kInvalid;
  if (health_.condition == BusCondition::kBusOff) {
    ++health_.withheld;
    return SendOutcome::kWithheld;
  }
  ++health_.sent;
  if (!is_lost()) put(frame, to_devices_);
  return SendOutcome::kQueued;
}

std::optional<ReceivedFrame> SimulatedBus::receive() {
  if (to_host_.empty() || to_host_.front().arrival > now_) return std::nullopt;
  const OnTheWire first = to_host_.front();
  to_host_.pop_front();
  ++health_.received;
  return ReceivedFrame{first.frame, Timestamp{(first.arrival - start_).count()}};
}

std::optional<MonotonicTime> SimulatedBus::retry_at() const {
  if (health_.condition != BusCondition::kBusOff) return std::nullopt;
  return now_ + kStep;
}

}  // namespace cairn::simulated
