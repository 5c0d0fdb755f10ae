// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "client/app/frame_observer.h"
#include "common/base/result.h"
#include "common/wire/wearer_messages.h"

namespace cairn {

/// Encodes BGR pixels as a JPEG, made small enough for a CameraPicture: no side longer than
/// kMaxCameraImageSide, no more bytes than kMaxCameraImageBytes, whatever they show.
[[nodiscard]] wire::ImageMessage encode_camera_image(const cv::Mat& pixels);
/// Decodes such an image to BGR. Error kDamaged: it cannot be decoded, is cut short, or is of another size
/// than is said.
[[nodiscard]] Result<cv::Mat> decode_camera_image(const wire::ImageMessage& image);

[[nodiscard]] TrackingState tracking_state_of(FrameState state);
[[nodiscard]] FrameState frame_state_of(TrackingState state);

}  // namespace cairn
