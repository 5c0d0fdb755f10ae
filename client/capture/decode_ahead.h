// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "client/capture/frame_source.h"

namespace cairn {

struct DecodeAheadOptions {
  size_t queue_frames = 30;  ///< decoded frames kept at most; a live source keeps only its newest
  bool preload = false;  ///< decode all before the first frame is given out (a 640x480 frame takes 0.3 MB)
};

/// Decodes a source in a thread of its own, so that next() of the frame loop only takes a finished picture.
/// Frames and errors come out in the order of the source. A recording waits for the consumer; a live source
/// does not: what the consumer is too slow for is dropped, oldest first, and shows as a gap in Frame::index.
class DecodeAhead final : public FrameSource {
 public:
  /// Starts to decode; with `preload` returns when all is decoded. kUsage for preloading a live source.
  [[nodiscard]] static Result<std::unique_ptr<DecodeAhead>> start(std::unique_ptr<FrameSource> source,
                                                                  const DecodeAheadOptions& options = {});
  /// Waits for the frame being decoded, discards the rest.
  ~DecodeAhead() override;
  DecodeAhead(const DecodeAhead&) = delete;
  DecodeAhead& operator=(const DecodeAhead&) = delete;

  Result<std::optional<Frame>> next() override;
  std::optional<size_t> frame_count() const override { return frame_count_; }
  std::optional<CameraParameters> builtin_calibration() const override { return calibration_; }
  std::string describe() const override { return description_; }
  bool is_live() const override { return is_live_; }

 private:
  DecodeAhead(std::unique_ptr<FrameSource> source, size_t capacity);
  void run();
  void wait_until_decoded();

  // Copies of what the source says of itself: the source belongs to the thread.
  const std::optional<size_t> frame_count_;
  const std::optional<CameraParameters> calibration_;
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
