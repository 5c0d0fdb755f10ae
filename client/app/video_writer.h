// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <opencv2/videoio.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/app/overlay.h"
#include "common/base/log.h"
#include "common/base/result.h"

namespace cairn {

/// Draws and encodes the overlay video in a thread of its own (--video). The rate is that of the
/// stamps of the first frames; while frames are missing the last image stands still, so the video keeps
/// time.
class VideoWriter final : public FrameObserver {
 public:
  enum class WhenBehind : uint8_t {
    kDropImages,  ///< realtime: tracking goes first
    kWait,        ///< every frame gets its image, unless a stop is requested
  };
  using StopRequested = std::function<bool()>;

  /// Whether files of such a name (.mp4, .avi, .mkv) are written, and it is no pipe or device. Error: kUsage.
  [[nodiscard]] static Status check_path(const std::filesystem::path& path);
  /// Checks the ending and that the file can be written; `stop_requested` is asked wherever push() or
  /// finish() wait. `log` is told once when the file grows no more: a camera may run for hours after its disk
  /// is full. Errors: kUsage (also where `path` is no regular file: an encoder goes back in it), kIo.
  [[nodiscard]] static Result<std::unique_ptr<VideoWriter>> open(
      const std::filesystem::path& path, CameraPtr camera, WhenBehind when_behind,
      StopRequested stop_requested = [] { return false; }, Logger log = null_logger());
  /// Completes the file as finish() does, without a report.
  ~VideoWriter() override;
  VideoWriter(const VideoWriter&) = delete;
  VideoWriter& operator=(const VideoWriter&) = delete;

  void on_frame(const FrameReport& report) override { push(make_overlay_frame(report)); }
  void push(OverlayFrame frame);

  /// Waits until the file is complete and checks that it is. An error when it could not be encoded or
  /// written. Call once, push() no more.
  [[nodiscard]] Status finish();
  /// Images left out because the thread was behind. After finish().
  [[nodiscard]] size_t images_dropped() const { return images_dropped_; }

 private:
  VideoWriter(std::filesystem::path path, CameraPtr camera, WhenBehind when_behind,
              StopRequested stop_requested, Logger log);
  void run();
  [[nodiscard]] std::optional<OverlayFrame> next();
  void encode();
  [[nodiscard]] Status open_file();
  [[nodiscard]] Status check_file() const;
  void write(const OverlayFrame& frame);
  void watch_growth();

  const std::filesystem::path path_;
  const WhenBehind when_behind_;
  const StopRequested stop_requested_;
  const Logger log_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<OverlayFrame> queue_;  ///< guarded by mutex_
  bool finishing_ = false;          ///< guarded by mutex_
  bool done_ = false;               ///< guarded by mutex_; nothing is taken from the queue any more
  size_t images_dropped_ = 0;       ///< guarded by mutex_

  // Of the thread.
  Overlay overlay_;
  cv::Mat image_;  ///< the last one written; shares the overlay's memory
  cv::VideoWriter file_;
  Status status_;
  std::vector<OverlayFrame> first_frames_;  ///< kept until the rate is known
  double frame_rate_ = 0;
  Timestamp start_;
  int64_t images_written_ = 0;
  uintmax_t bytes_ = 0;           ///< of the file, when it was looked at last
  int64_t images_at_growth_ = 0;  ///< written when it was last seen to have grown
  bool standstill_told_ = false;
  std::thread thread_;  ///< last: it uses all the above
};

}  // namespace cairn
