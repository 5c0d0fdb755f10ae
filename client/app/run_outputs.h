// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "client/app/stats.h"
#include "client/app/track_options.h"
#include "client/app/trajectory_recorder.h"
#include "client/app/video_writer.h"
#include "common/base/log.h"
#include "common/base/stream_writer.h"
#include "common/geometry/camera.h"

namespace cairn {

/// Checks whether all files that a run writes can be written, and that none is another of them, a file that
/// the run reads, or its log. What an earlier run left stays as it is. `calibration`: the file that was read,
/// if any; `calibration_to_save`: where a camera that is calibrated is written, if it is. Errors: kUsage,
/// kIo.
[[nodiscard]] Status check_outputs(const TrackOptions& options,
                                   const std::optional<std::filesystem::path>& calibration,
                                   const std::optional<std::filesystem::path>& calibration_to_save);

/// The files of a run (--trajectory, --stats, --video), each written in a thread of its own. Nothing here
/// waits for a reader but close(), and that not for long.
class RunOutputs {
 public:
  using StopRequested = std::function<bool()>;

  /// Begins the files: what an earlier run left is gone from here on. Errors: kUsage, kIo.
  [[nodiscard]] static Result<RunOutputs> open(const TrackOptions& options, const CameraPtr& camera,
                                               const StopRequested& stop_requested, const Logger& log);

  /// The outputs that listen to the frame loop.
  [[nodiscard]] std::vector<FrameObserver*> observers() const;
  /// Completes all files, whatever one of them meets; returns the first error, and logs the others. Call
  /// once.
  [[nodiscard]] Status close(const RunStats& stats, uint64_t bytes_sent, uint64_t bytes_received);

 private:
  RunOutputs(StopRequested stop_requested, Logger log)
      : stop_requested_(std::move(stop_requested)), log_(std::move(log)) {}

  StopRequested stop_requested_;
  Logger log_;
  std::unique_ptr<TrajectoryRecorder> trajectory_;
  std::unique_ptr<VideoWriter> video_;
  std::unique_ptr<StreamWriter> stats_;
};

}  // namespace cairn
