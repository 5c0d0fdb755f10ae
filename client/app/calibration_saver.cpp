// SPDX-License-Identifier: Apache-2.0
#include "client/app/calibration_saver.h"

#include <chrono>
#include <fstream>

#include "common/io/calibration.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kSlice(100);  ///< how long a request to stop may go unheard

/// Writes the camera's file. What is thrown meanwhile (memory, the log) counts as this file's fault: the
/// run's other files are closed all the same.
Status write(const std::filesystem::path& path, const CameraPtr& camera, const std::string& how,
             const Logger& log) {
  try {
    if (auto written = write_calibration_kalibr(path, camera->parameters(), how); !written) return written;
    log->info("camera written to {}; next time: --calibration {}", path.string(), path.string());
    return {};
  } catch (const std::exception& problem) {
    return fail(ErrorCode::kIo, path.string() + ": " + problem.what());
  }
}

}  // namespace

Status check_writable(const std::filesystem::path& path) {
  std::error_code unknown;
  const bool was_there = std::filesystem::exists(std::filesystem::symlink_status(path, unknown));
  // What reads from a pipe would see it end.
  if (was_there && !std::filesystem::is_regular_file(path, unknown) &&
      !std::filesystem::is_directory(path, unknown))
    return {};
  if (!std::ofstream(path, std::ios::binary | std::ios::app))
    return fail(ErrorCode::kIo, cannot_be_written(path));
  if (!was_there) std::filesystem::remove(path, unknown);
  return {};
}

void CalibrationSaver::on_camera(const CameraUpdate& update) {
  if (latest_ && latest_->frozen) return;
  latest_ = update;
  if (!update.frozen) return;
  const std::string how = "calibrated by cairn-track while a map grew: " + describe(update);
  written_ = std::async(std::launch::async, write, path_, update.camera, how, log_);
}

Status CalibrationSaver::finish(const std::function<bool()>& stop_requested) {
  if (!latest_ || !latest_->frozen) {
    return fail(ErrorCode::kDegenerate, "the camera is not known well enough, none was written: " +
                                            (latest_ ? describe(*latest_) : "no map was made long enough"));
  }
  // Whoever asks hears the first signal, and the second then has its default effect.
  while (written_.wait_for(kSlice) != std::future_status::ready) (void)stop_requested();
  return written_.get();
}

}  // namespace cairn
