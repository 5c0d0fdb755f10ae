// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "client/app/frame_observer.h"
#include "common/base/log.h"

namespace cairn {

/// Writes a camera that was found out as Kalibr's yaml, when it is known.
class CameraKeeper final : public FrameObserver {
 public:
  CameraKeeper(std::filesystem::path path, Logger log) : path_(std::move(path)), log_(std::move(log)) {}

  void on_camera(const CameraNews& news) override;
  /// After a run: says so when the camera is not known.
  void finish();

 private:
  const std::filesystem::path path_;
  Logger log_;
  std::optional<CameraNews> latest_;
};

}  // namespace cairn
