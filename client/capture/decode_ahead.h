// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "client/capture/frame_source.h"

namespace cairn {

/// Decodes a source in a thread of its own, so that next() of the frame loop only takes a finished image.
/// Frames and errors come out in the order of the source. A recording waits for the consumer; a live source
/// does not: what the consumer is too slow for is dropped, oldest first, and shows as a gap in Frame::index.
class DecodeAhead final : public FrameSource {
 public:
  /// Starts to decode and keeps at most `queue_frames` (at least one) frames of a recording.
  explicit DecodeAhead(std::unique_ptr<FrameSource> source, size_t queue_frames = 30);
  /// Waits for the frame being decoded, discards the rest.
  ~DecodeAhead() override;
  DecodeAhead(const DecodeAhead&) = delete;
  DecodeAhead& operator=(const DecodeAhead&) = delete;

  [[nodiscard]] Result<std::optional<Frame>> next() override;
  std::optional<size_t> frame_count() const override { return frame_count_; }
  std::optional<CameraParameters> builtin_calibration() const override { return calibration_; }
  std::optional<ImageSize> image_size() const override { return image_size_; }
  std::string describe() const override { return description_; }
  bool is_live() const override { return is_live_; }

 private:
  void run();
  [[nodiscard]] Result<std::optional<Frame>> next_of_source();

  // Copies of what the source says of itself: the source belongs to the thread.
  const std::optional<size_t> frame_count_;
  const std::optional<CameraParameters> calibration_;
  const std::optional<ImageSize> image_size_;
  const std::string description_;
  const bool is_live_;
  const size_t capacity_;
  const std::unique_ptr<FrameSource> source_;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Result<std::optional<Frame>>> queue_;  ///< guarded by mutex_
  bool at_end_ = false;                             ///< guarded by mutex_: the source gave its last
  bool stopping_ = false;                           ///< guarded by mutex_
  std::thread thread_;                              ///< last: it uses all the above
};

}  // namespace cairn
