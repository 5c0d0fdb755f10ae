// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>

#include "client/app/frame_observer.h"
#include "common/base/log.h"
#include "common/io/trajectory.h"

namespace cairn {

/// Writes the pose of every tracked frame when it is tracked (DESIGN 10, --trajectory). A row that cannot be
/// written is told at once: a camera may run for hours after its disk is full.
class TrajectoryRecorder final : public FrameObserver {
 public:
  TrajectoryRecorder(TrajectoryWriter writer, Logger log)
      : writer_(std::move(writer)), log_(std::move(log)) {}

  void on_frame(const FrameReport& report) override {
    if (!is_tracked(report.state)) return;
    const auto& result = report.result;
    const bool named = report.snapshot && report.snapshot->map == result.map;
    auto written = writer_.append(result.map, named ? report.snapshot->name : std::string(),
                                  {report.frame.time, result.camera_from_map.inverse()});
    if (written || !status_) return;
    status_ = std::move(written);
    log_->error("{}; going on", status_.error().message);
  }

  /// The first error in writing, e.g. a full disk.
  [[nodiscard]] const Status& status() const { return status_; }

 private:
  TrajectoryWriter writer_;
  Logger log_;
  Status status_;
};

}  // namespace cairn
