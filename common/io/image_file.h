// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "common/base/result.h"
#include "common/image/image.h"
#include "common/image/limits.h"

namespace cairn {

/// The values that become 0 and 255 in images with more than 8 bits. Values below and above become 0 and 255
/// too.
struct GrayLevels {
  int black = 0;
  int white = 65535;
  bool exchange_bytes = false;  ///< the file has the low byte first, against the format
};

/// Grey pixels as they are in a file with up to 16 bits, row after row.
struct DeepImage {
  int width = 0;
  int height = 0;
  std::vector<uint16_t> pixels;
};

/// Decodes a PNG, JPEG or PGM/PPM to 8-bit grey, row by row as it is kept: an orientation tag is ignored.
/// Error kDamaged (without a file name) for anything that is not a whole image of at most kMaxImageSide. Of
/// images with more than 8 bits the upper 8 are taken, or what `levels` makes of them. Thread-safe.
[[nodiscard]] Result<GrayImage> decode_gray_image(std::span<const uint8_t> bytes,
                                                  const std::optional<GrayLevels>& levels = {});
/// Decodes an image as decode_gray_image() does, but keeps all bits.
[[nodiscard]] Result<DeepImage> decode_deep_image(std::span<const uint8_t> bytes);

/// Reads an image file and decodes it as decode_gray_image() does, but turned upright as viewers show it
/// (orientation.h). Errors name the file: kNotFound, kIo, kDamaged (empty, cut, not an image).
[[nodiscard]] Result<GrayImage> read_gray_image(const std::filesystem::path& path,
                                                const std::optional<GrayLevels>& levels = {});

}  // namespace cairn
