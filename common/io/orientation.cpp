// SPDX-License-Identifier: Apache-2.0
#include "common/io/orientation.h"

#include <array>
#include <opencv2/core.hpp>

namespace cairn {
namespace {

constexpr uint32_t kOrientationTag = 0x0112;
constexpr size_t kEntryBytes = 12;

struct Reader {
  std::span<const uint8_t> bytes;
  bool is_little_endian;

  /// Nothing beyond the end: 0, which is no orientation and no entry.
  [[nodiscard]] uint32_t number(size_t at, size_t size) const {
    if (at > bytes.size() || size > bytes.size() - at) return 0;
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) value = value << 8 | bytes[at + (is_little_endian ? size - 1 - i : i)];
    return value;
  }
};

/// First mirrored left to right, then turned clockwise.
struct Change {
  bool is_mirrored;
  int quarters;
};
constexpr std::array<Change, 9> kChanges = {Change{false, 0}, {false, 0}, {true, 0}, {false, 2}, {true, 2},
                                            {true, 3},        {false, 1}, {true, 1}, {false, 3}};

Change change_of(int orientation) {
  return orientation < kUpright || orientation > 8 ? kChanges[0] : kChanges[static_cast<size_t>(orientation)];
}

}  // namespace

int exif_orientation(std::span<const uint8_t> tiff) {
  if (tiff.size() < 8 || tiff[0] != tiff[1] || (tiff[0] != 'I' && tiff[0] != 'M')) return kUpright;
  const Reader reader{tiff, tiff[0] == 'I'};
  const size_t directory = reader.number(4, 4);
  const size_t entries = reader.number(directory, 2);
  for (size_t i = 0; i < entries; ++i) {
    const size_t entry = directory + 2 + i * kEntryBytes;
    if (reader.number(entry, 2) != kOrientationTag) continue;
    const auto value = static_cast<int>(reader.number(entry + 8, 2));
    return value >= kUpright && value <= 8 ? value : kUpright;
  }
  return kUpright;
}

bool lies_on_its_side(int orientation) {
  return change_of(orientation).quarters % 2 == 1;
}

std::string orientation_words(int orientation) {
  const auto [is_mirrored, quarters] = change_of(orientation);
  const std::string turned =
      quarters == 0 ? "" : "turned by " + std::to_string(90 * quarters) + " degrees clockwise";
  if (!is_mirrored) return turned;
  return turned.empty() ? "mirrored" : "mirrored and " + turned;
}

cv::Mat upright(const cv::Mat& pixels, int orientation) {
  const auto [is_mirrored, quarters] = change_of(orientation);
  cv::Mat shown = pixels;
  if (is_mirrored) cv::flip(pixels, shown, 1);
  if (quarters == 0) return shown;
  cv::Mat turned;
  cv::rotate(shown, turned, quarters - 1);  // cv::RotateFlags counts so
  return turned;
}

}  // namespace cairn
