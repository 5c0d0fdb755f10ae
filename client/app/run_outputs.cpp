// SPDX-License-Identifier: Apache-2.0
#include "client/app/run_outputs.h"

#include <utility>

#include "client/app/calibration_saver.h"
#include "client/capture/frame_source.h"
#include "common/io/calibration.h"
#include "common/io/distinct_files.h"

namespace cairn {
namespace {

constexpr const char* kLog = "/dev/stderr";

std::vector<NamedFile> files_read(const TrackOptions& options,
                                  const std::optional<std::filesystem::path>& calibration) {
  std::vector<NamedFile> files;
  if (calibration) files.push_back({"--calibration", calibration_file(*calibration)});
  if (!options.config.empty()) files.push_back({"--config", options.config});
  if (options.labels) files.push_back({"--labels", *options.labels});
  if (options.imu.samples) files.push_back({"--imu", *options.imu.samples});
  for (const auto& path : source_files(options.source)) files.push_back({"--source", path});
  return files;
}

}  // namespace

Status check_outputs(const TrackOptions& options, const std::optional<std::filesystem::path>& calibration,
                     const std::optional<std::filesystem::path>& calibration_to_save) {
  if (options.video) {
    if (Status video = VideoWriter::check_path(*options.video); !video) return video;
  }
  std::vector<NamedFile> files;
  if (options.trajectory) files.push_back({"--trajectory", *options.trajectory});
  if (options.stats) files.push_back({"--stats", *options.stats});
  if (options.video) files.push_back({"--video", *options.video});
  const std::vector<NamedFile> opened = files;
  if (options.saved_calibration) files.push_back({"--save-calibration", *options.saved_calibration});
  if (Status distinct = check_distinct(files, files_read(options, calibration)); !distinct) return distinct;
  // Nobody asked for this name: an earlier one of it may be what was read, and is improved.
  if (calibration_to_save && !options.saved_calibration)
    files.push_back({"the camera that is calibrated,", *calibration_to_save});
  files.push_back({"the log on", kLog});
  if (Status distinct = check_distinct(files, {}); !distinct) return distinct;
  for (const auto& file : opened) {
    if (Status writable = check_writable(file.path); !writable) return writable;
  }
  return {};
}

Result<RunOutputs> RunOutputs::open(const TrackOptions& options, const CameraPtr& camera,
                                    const StopRequested& stop_requested, const Logger& log) {
  RunOutputs outputs(stop_requested, log);
  if (options.trajectory) {
    auto writer = TrajectoryWriter::open(*options.trajectory);
    if (!writer) return tl::unexpected(writer.error());
    outputs.trajectory_ = std::make_unique<TrajectoryRecorder>(std::move(*writer), log);
  }
  if (options.stats) {
    auto stats = StreamWriter::open(*options.stats);
    if (!stats) return tl::unexpected(stats.error());
    outputs.stats_ = std::move(*stats);
  }
  if (options.video) {
    const auto when_behind = options.pace == Pace::kRealtime ? VideoWriter::WhenBehind::kDropImages
                                                             : VideoWriter::WhenBehind::kWait;
    auto video = VideoWriter::open(*options.video, camera, when_behind, stop_requested, log);
    if (!video) return tl::unexpected(video.error());
    outputs.video_ = std::move(*video);
  }
  return outputs;
}

std::vector<FrameObserver*> RunOutputs::observers() const {
  std::vector<FrameObserver*> observers;
  if (trajectory_) observers.push_back(trajectory_.get());
  if (video_) observers.push_back(video_.get());
  return observers;
}

Status RunOutputs::close(const RunStats& stats, uint64_t bytes_sent, uint64_t bytes_received) {
  Status first;
  const auto note = [&](Status status) {
    if (!status && first)
      first = std::move(status);
    else if (!status)
      log_->error("{}", status.error().message);
  };
  if (video_) note(video_->finish());
  if (video_ && video_->images_dropped() > 0)
    log_->info("--video: {} images left out, tracking went first", video_->images_dropped());
  if (stats_) {
    (void)stats_->write(stats.to_json(bytes_sent, bytes_received));  // finish() says what is missing
    note(stats_->finish({}, stop_requested_));
  }
  if (trajectory_) note(trajectory_->finish(stop_requested_));
  return first;
}

}  // namespace cairn
