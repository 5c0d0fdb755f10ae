// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "client/inertial/imu_sample.h"

namespace cairn {

/// Where a frame loop gets the samples of its camera's IMU from.
class ImuStream {
 public:
  virtual ~ImuStream() = default;
  [[nodiscard]] virtual ImuMount mount() const = 0;
  /// Appends the samples that were not taken yet, as far as a frame of `time` (the camera's clock) needs
  /// them: up to the first one at or after it. Never waits.
  virtual void take(Timestamp time, std::vector<ImuSample>* samples) = 0;
};

/// All samples of a recording, in order of time. One thread.
class ImuRecording final : public ImuStream {
 public:
  ImuRecording(const ImuMount& mount, std::vector<ImuSample> samples)
      : mount_(mount), samples_(std::move(samples)) {}

  [[nodiscard]] ImuMount mount() const override { return mount_; }
  void take(Timestamp time, std::vector<ImuSample>* samples) override {
    while (next_ < samples_.size()) {
      samples->push_back(samples_[next_++]);
      if (samples->back().time + mount_.clock_offset >= time) return;
    }
  }

 private:
  ImuMount mount_;
  std::vector<ImuSample> samples_;
  size_t next_ = 0;
};

/// Samples as they come from a device, put in by one thread and taken by another. What nobody takes is
/// forgotten, the oldest first.
class ImuQueue final : public ImuStream {
 public:
  explicit ImuQueue(const ImuMount& mount) : mount_(mount) {}

  [[nodiscard]] ImuMount mount() const override { return mount_; }
  void put(const ImuSample& sample) {
    const std::lock_guard lock(mutex_);
    if (samples_.size() == kMost) samples_.erase(samples_.begin(), samples_.begin() + kMost / 2);
    samples_.push_back(sample);
  }
  /// All that have come.
  void take(Timestamp /*time*/, std::vector<ImuSample>* samples) override {
    const std::lock_guard lock(mutex_);
    samples->insert(samples->end(), samples_.begin(), samples_.end());
    samples_.clear();
  }

 private:
  static constexpr size_t kMost = 4096;

  ImuMount mount_;
  std::mutex mutex_;
  std::vector<ImuSample> samples_;
};

using ImuStreamPtr = std::unique_ptr<ImuStream>;

}  // namespace cairn
