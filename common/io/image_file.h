// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>

#include "common/base/result.h"
#include "common/image/image.h"
#include "common/image/limits.h"

namespace cairn {

/// Decodes a PNG, JPEG or PGM/PPM to 8-bit grey; the orientation tag of phones is ignored, because
/// calibrations are of the sensor's rows and columns. Error kDamaged (without a file name) for anything that
/// is not a whole image of at most kMaxImageSide. Thread-safe.
[[nodiscard]] Result<GrayImage> decode_gray_image(std::span<const uint8_t> bytes);

/// As decode_gray_image() from a file; errors name it: kNotFound, kIo, kDamaged (empty, cut, not an image).
[[nodiscard]] Result<GrayImage> read_gray_image(const std::filesystem::path& path);

}  // namespace cairn
