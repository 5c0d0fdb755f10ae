// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/imgcodecs.hpp>
#include <vector>

/// Images as phones write them.
namespace cairn {

/// The TIFF structure of an Exif that has the orientation, behind another entry.
inline std::vector<uint8_t> exif_of(int orientation, bool is_little_endian = false) {
  std::vector<uint8_t> bytes(2, is_little_endian ? 'I' : 'M');
  const auto put = [&](uint32_t value, int size) {
    for (int i = 0; i < size; ++i)
      bytes.push_back(static_cast<uint8_t>(value >> (8 * (is_little_endian ? i : size - 1 - i))));
  };
  put(42, 2);
  put(8, 4);  // where the directory is
  put(2, 2);  // entries: tag, type (3: 16 bits), count, value
  for (const auto& [tag, value] : {std::pair(0x0106, 2), std::pair(0x0112, orientation)}) {
    put(static_cast<uint32_t>(tag), 2);
    put(3, 2);
    put(1, 4);
    put(static_cast<uint32_t>(value), 2);
    put(0, 2);
  }
  put(0, 4);
  return bytes;
}

/// A JPEG with that Exif.
inline std::vector<uint8_t> jpeg_held(const cv::Mat& pixels, int orientation, bool is_little_endian = false) {
  std::vector<uint8_t> jpeg;
  cv::imencode(".jpg", pixels, jpeg);
  const auto exif = exif_of(orientation, is_little_endian);
  std::vector<uint8_t> segment = {0xFF, 0xE1, 0, static_cast<uint8_t>(2 + 6 + exif.size()), 'E', 'x', 'i',
                                  'f',  0,    0};
  segment.insert(segment.end(), exif.begin(), exif.end());
  jpeg.insert(jpeg.begin() + 2, segment.begin(), segment.end());
  return jpeg;
}

}  // namespace cairn
