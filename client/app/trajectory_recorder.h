// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <utility>

#include "client/app/frame_observer.h"
#include "common/base/log.h"
#include "common/io/trajectory.h"

namespace cairn {

/// Writes the pose of every tracked frame when it is tracked (--trajectory). A row that cannot be
/// written is told at once: a camera may run for hours after its disk is full.
class TrajectoryRecorder final : public FrameObserver {
 public:
  TrajectoryRecorder(TrajectoryWriter writer, Logger log)
      : writer_(std::move(writer)), log_(std::move(log)) {}

  void on_frame(const FrameReport& report) override {
    if (!is_tracked(report.state)) return;
    const auto& result = report.result;
    const bool named = report.snapshot && report.snapshot->map == result.map;
    const auto written = writer_.append(result.map, named ? report.snapshot->name : std::string(),
                                        {report.frame.time, result.camera_from_map.inverse()});
    if (!written && !std::exchange(is_told_, true)) log_->error("{}; going on", written.error().message);
  }

  /// Waits for the rows that are not yet written, for a reader of a pipe only for a while. An error where any
  /// is missing. Call once, after the last frame.
  [[nodiscard]] Status finish(const std::function<bool()>& stop_requested) {
    return writer_.finish({}, stop_requested);
  }

 private:
  TrajectoryWriter writer_;
  Logger log_;
  bool is_told_ = false;
};

}  // namespace cairn
