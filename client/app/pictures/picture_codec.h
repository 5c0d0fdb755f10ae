// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "client/app/frame_observer.h"
#include "common/base/result.h"
#include "common/wire/picture_messages.h"

namespace cairn {

/// Of BGR pixels, made small enough for a CameraPicture: no side longer than kMaxPictureSide, no more bytes
/// than kMaxPictureBytes, whatever they show.
[[nodiscard]] wire::ImageMessage encode_picture(const cv::Mat& pixels);
/// Error kDamaged: no JPEG, or of another size than is said.
[[nodiscard]] Result<cv::Mat> decode_picture(const wire::ImageMessage& picture);

[[nodiscard]] TrackingState tracking_state_of(FrameState state);
[[nodiscard]] FrameState frame_state_of(TrackingState state);

}  // namespace cairn
