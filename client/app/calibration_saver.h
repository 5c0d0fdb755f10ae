// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <future>
#include <optional>

#include "client/app/frame_observer.h"
#include "common/base/log.h"
#include "common/base/result.h"

namespace cairn {

/// Whether a file could be written there; leaves what is there as it is, and what is no file unasked.
[[nodiscard]] Status check_writable(const std::filesystem::path& path);

/// Writes a camera that was calibrated with the map as Kalibr's yaml, when it is known, in a thread of its
/// own.
class CalibrationSaver final : public FrameObserver {
 public:
  CalibrationSaver(std::filesystem::path path, Logger log) : path_(std::move(path)), log_(std::move(log)) {}

  void on_camera(const CameraUpdate& update) override;
  /// Waits after a run until the camera is written. `stop_requested` is asked meanwhile so that the first
  /// signal is heard; it does not end the wait. Errors: kDegenerate, the camera is not known; kIo, it is, but
  /// could not be written. Call once.
  [[nodiscard]] Status finish(const std::function<bool()>& stop_requested);

 private:
  const std::filesystem::path path_;
  Logger log_;
  std::optional<CameraUpdate> latest_;
  std::future<Status> written_;  ///< valid once the camera is known
};

}  // namespace cairn
