// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>

#include "client/capture/frame_source.h"

namespace cairn {

/// A recording decoded into memory: next() costs nothing. Frames and errors come in the order of the
/// recording.
class MemorySource final : public FrameSource {
 public:
  /// Decodes all of `recording`, or as far as it is when `stop_requested` says so (asked before each frame).
  /// Not for live sources, which do not end.
  MemorySource(FrameSource& recording, const std::function<bool()>& stop_requested);

  [[nodiscard]] Result<std::optional<Frame>> next() override;
  std::optional<size_t> frame_count() const override { return frame_count_; }
  std::optional<CameraParameters> builtin_calibration() const override { return calibration_; }
  std::optional<ImageSize> image_size() const override { return image_size_; }
  std::string describe() const override { return description_; }

 private:
  const std::optional<size_t> frame_count_;
  const std::optional<CameraParameters> calibration_;
  const std::optional<ImageSize> image_size_;
  const std::string description_;
  std::deque<Result<std::optional<Frame>>> items_;
};

}  // namespace cairn
