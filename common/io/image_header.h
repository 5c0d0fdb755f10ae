// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "common/base/result.h"

namespace cairn {

enum class ImageFormat : uint8_t { kPng, kJpeg, kPnm };

/// What an image file says of itself before a pixel is decoded.
struct ImageHeader {
  ImageFormat format = ImageFormat::kPng;
  int64_t width = 0;
  int64_t height = 0;
  int bits = 8;         ///< of a sample
  int orientation = 1;  ///< as viewers show it, see orientation.h; width and height are those of the rows
  /// Whether the file has its end; decoders paint the missing part of a cut JPEG grey in silence.
  bool complete = true;
};

/// Reads the header of a PNG, JPEG or PGM/PPM file. Error kDamaged (without a file name) for anything else
/// and for a file that ends before its size is known. Never reads outside `bytes`, allocates nothing.
[[nodiscard]] Result<ImageHeader> read_image_header(std::span<const uint8_t> bytes);

}  // namespace cairn
