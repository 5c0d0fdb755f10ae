// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/image/image.h"
#include "common/wire/messages.h"

namespace cairn {

/// JPEG quality of keyframes on slow links: corners move by less than a tenth of a pixel.
constexpr int kJpegQuality = 95;

/// The image as it travels: raw bytes without padding, or JPEG. Thread-safe.
[[nodiscard]] wire::ImageMessage encode_image(const GrayView& image, wire::ImageEncoding encoding);

}  // namespace cairn
