// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "client/inertial/encoder_turns.h"
#include "client/inertial/imu_sample.h"

namespace cairn {

/// The source of the samples of a camera's IMU, from which a frame loop takes them.
class ImuStream {
 public:
  virtual ~ImuStream() = default;
  /// The IMU's mount as it is known at present. Nothing: it is not known, and the samples serve nothing.
  [[nodiscard]] virtual std::optional<ImuMount> mount() const = 0;
  /// Appends the samples that were not taken yet, as far as a frame of `time` (the camera's clock) needs
  /// them: up to the first one at or after it. Never waits.
  virtual void take(Timestamp time, std::vector<ImuSample>* samples) = 0;
  /// Appends the samples of the encoders of a rig that carries the camera: all that have come and were not
  /// taken yet. None without such a rig.
  virtual void take_encoders(std::vector<EncoderSample>* /*samples*/) {}
};

/// All samples of a recording, in order of time. One thread.
class ImuRecording final : public ImuStream {
 public:
  ImuRecording(const ImuMount& mount, std::vector<ImuSample> samples)
      : mount_(mount), samples_(std::move(samples)) {}

  [[nodiscard]] std::optional<ImuMount> mount() const override { return mount_; }
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

/// Samples as they come from a device, and how it sits as far as is known by then: put in by one thread and
/// taken by another. What nobody takes is forgotten, the oldest first.
class ImuQueue final : public ImuStream {
 public:
  explicit ImuQueue(const std::optional<ImuMount>& mount = std::nullopt) : mount_(mount) {}

  [[nodiscard]] std::optional<ImuMount> mount() const override {
    const std::lock_guard lock(mutex_);
    return mount_;
  }
  /// Sets the mount that counts from now on.
  void set_mount(const std::optional<ImuMount>& mount) {
    const std::lock_guard lock(mutex_);
    mount_ = mount;
  }
  void put(const ImuSample& sample) { append(sample, &samples_); }
  void put(const EncoderSample& sample) { append(sample, &encoders_); }
  /// Appends all samples that have come and were not taken yet, whatever the time.
  void take(Timestamp /*time*/, std::vector<ImuSample>* samples) override { move_all(&samples_, samples); }
  void take_encoders(std::vector<EncoderSample>* samples) override { move_all(&encoders_, samples); }

 private:
  static constexpr size_t kMost = 4096;

  template <typename Sample>
  void append(const Sample& sample, std::vector<Sample>* samples) {
    const std::lock_guard lock(mutex_);
    if (samples->size() == kMost) samples->erase(samples->begin(), samples->begin() + kMost / 2);
    samples->push_back(sample);
  }
  template <typename Sample>
  void move_all(std::vector<Sample>* from, std::vector<Sample>* to) {
    const std::lock_guard lock(mutex_);
    to->insert(to->end(), from->begin(), from->end());
    from->clear();
  }

  mutable std::mutex mutex_;
  std::optional<ImuMount> mount_;   ///< guarded by mutex_
  std::vector<ImuSample> samples_;  ///< likewise
  std::vector<EncoderSample> encoders_;
};

using ImuStreamPtr = std::unique_ptr<ImuStream>;

}  // namespace cairn
