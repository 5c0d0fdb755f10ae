// SPDX-License-Identifier: Apache-2.0
#include "client/app/camera_keeper.h"

#include <fstream>

#include "common/io/calibration.h"
#include "common/io/text.h"

namespace cairn {

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

void CameraKeeper::on_camera(const CameraNews& news) {
  if (latest_ && latest_->frozen) return;
  latest_ = news;
  if (!news.frozen) return;
  const std::string how = "found out by cairn-track while a map grew: " + describe(news);
  written_ = write_calibration_kalibr(path_, news.camera->parameters(), how);
  if (written_)
    log_->info("camera written to {}; next time: --calibration {}", path_.string(), path_.string());
}

Status CameraKeeper::finish() const {
  if (!latest_ || !latest_->frozen) {
    return fail(ErrorCode::kDegenerate, "the camera is not known well enough, none was written: " +
                                            (latest_ ? describe(*latest_) : "no map was made long enough"));
  }
  return written_;
}

}  // namespace cairn
