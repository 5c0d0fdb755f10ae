// SPDX-License-Identifier: Apache-2.0
#include "hw/app/offset_watch.h"

#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

namespace cairn {
namespace {

constexpr double kSharp = 0.005;       // [s]: beyond, the configuration's is as good
constexpr double kWorthTelling = 2e6;  // [ns]

}  // namespace

std::optional<wire::RigCameraClock> camera_clock_of(const CameraAndGyro& found) {
  if (!(found.sigma <= kSharp)) return std::nullopt;
  return wire::RigCameraClock{true, std::llround(found.offset * 1e9), static_cast<float>(found.sigma)};
}

OffsetWatch::OffsetWatch(Logger log, Teller tell, std::chrono::milliseconds period)
    : log_(std::move(log)), tell_(std::move(tell)), period_(period) {
  thread_ = std::thread(&OffsetWatch::run, this);
}

OffsetWatch::~OffsetWatch() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

void OffsetWatch::sense(const std::vector<GyroSample>& samples) {
  const std::lock_guard lock(mutex_);
  for (const GyroSample& sample : samples) sensed_.sense(sample);
}

void OffsetWatch::see(const CameraRotation& rotation, SessionId tracker) {
  const std::lock_guard lock(mutex_);
  if (tracker_ && *tracker_ != tracker) {
    sensed_.forget_camera();
    is_other_camera_ = true;
    changed_.notify_all();
  }
  tracker_ = tracker;
  sensed_.see(rotation);
  has_news_ = true;
}

void OffsetWatch::run() {
  bool withdraws_later = false;
  std::unique_lock lock(mutex_);
  while (!ends_) {
    changed_.wait_for(lock, period_, [this] { return ends_ || is_other_camera_; });
    const bool withdraws_now = std::exchange(withdraws_later, false);
    const bool is_other_camera = std::exchange(is_other_camera_, false) || withdraws_now;
    if (ends_ || (!is_other_camera && !std::exchange(has_news_, false))) continue;
    const ClockOffset sensed = sensed_;
    lock.unlock();
    const bool is_done = work(sensed, is_other_camera);
    lock.lock();
    withdraws_later = !is_done && is_other_camera;
    has_news_ = has_news_ || !is_done;
  }
}

/// Estimates the offset, or withdraws it where another tracker has the camera. False where that failed.
bool OffsetWatch::work(const ClockOffset& sensed, bool is_other_camera) {
  try {
    if (is_other_camera) {
      withdraw("another tracker has the camera");
    } else {
      estimate(sensed);
    }
    return true;
  } catch (const std::exception& error) {
    if (warning_.due())
      log_->error("offset of the camera's clock: {}; it is tried again, and until then the last one holds",
                  error.what());
    return false;
  }
}

void OffsetWatch::withdraw(const std::string& why) {
  if (!told_) return;
  tell_({});
  told_.reset();
  log_->info("the offset of the camera's stamps is as configured again: {}", why);
}

void OffsetWatch::estimate(const ClockOffset& sensed) {
  const auto found = sensed.estimate();
  if (!found) {
    log_->debug("offset of the camera's clock: {}", found.error().message);
    if (found.error().code == ErrorCode::kConfiguration) withdraw(found.error().message);
    return;
  }
  const auto clock = camera_clock_of(*found);
  if (!clock)
    return log_->debug("offset of the camera's clock: known to {:.1f} ms only", found->sigma * 1000);
  if (!told_ || std::abs(static_cast<double>(clock->offset - told_->offset)) > kWorthTelling)
    log_->info("stamps of the camera lack {:.1f} ms to the IMU's, known to {:.1f} ms",
               static_cast<double>(clock->offset) * 1e-6, static_cast<double>(clock->sigma) * 1000);
  tell_(*clock);
  told_ = clock;
}

}  // namespace cairn
