// SPDX-License-Identifier: Apache-2.0
#include "client/app/camera_keeper.h"

#include "common/io/calibration.h"

namespace cairn {

void CameraKeeper::on_camera(const CameraNews& news) {
  if (latest_ && latest_->frozen) return;
  latest_ = news;
  if (!news.frozen) return;
  const std::string how = "found out by cairn-track --calibration auto: " + describe(news);
  if (Status written = write_calibration_kalibr(path_, news.camera->parameters(), how); !written) {
    log_->error("{}", written.error().message);
  } else {
    log_->info("camera written to {}; next time: --calibration {}", path_.string(), path_.string());
  }
}

void CameraKeeper::finish() {
  if (latest_ && latest_->frozen) return;
  log_->warn("the camera is not known well enough, none was written: {}",
             latest_ ? describe(*latest_) : "no map was made long enough");
}

}  // namespace cairn
