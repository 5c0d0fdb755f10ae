// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "common/base/log.h"
#include "common/base/rate_limit.h"
#include "common/wire/rig_messages.h"
#include "hw/calibration/clock_offset.h"

namespace cairn {

/// The offset of the camera's clock by an estimate; nothing where that is not sharp enough. Pure.
[[nodiscard]] std::optional<wire::RigCameraClock> camera_clock_of(const CameraAndGyro& found);

/// Estimates while the rig is at work how the stamps of its camera differ from those of the IMU: once every
/// `period`, in a thread of its own, for it takes some hundredths of a second. Where the camera does not
/// turn, or nobody tracks it, the last estimate holds; it is withdrawn (told as not known) where gyro and
/// camera do not turn alike any more, and when another tracker has the camera. Stamps of both are of the
/// rig's clock. An estimate that throws is logged, and made again after a `period`. Thread-safe.
class OffsetWatch {
 public:
  /// `tell` is called by the thread.
  using Teller = std::function<void(const wire::RigCameraClock&)>;
  OffsetWatch(Logger log, Teller tell, std::chrono::milliseconds period = std::chrono::seconds(10));
  ~OffsetWatch();
  OffsetWatch(const OffsetWatch&) = delete;
  OffsetWatch& operator=(const OffsetWatch&) = delete;

  void sense(const std::vector<GyroSample>& samples);
  /// `tracker`: another one may have another camera.
  void see(const CameraRotation& rotation, SessionId tracker);

 private:
  void run();
  [[nodiscard]] bool work(const ClockOffset& sensed, bool is_other_camera);
  void estimate(const ClockOffset& sensed);
  void withdraw(const std::string& why);

  const Logger log_;
  const Teller tell_;
  const std::chrono::milliseconds period_;
  std::optional<wire::RigCameraClock> told_;  ///< of the thread
  RateLimit warning_;                         ///< of the thread
  std::mutex mutex_;                          ///< for what follows
  std::condition_variable changed_;
  ClockOffset sensed_;
  bool has_news_ = false;             ///< images since the last estimate
  std::optional<SessionId> tracker_;  ///< whose images they are
  bool is_other_camera_ = false;      ///< since the last estimate
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace cairn
