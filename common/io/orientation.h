// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <span>
#include <string>

/// How phones held a camera: its rows stay those of the sensor, and a tag says where up is (Exif 2.32, 4.6.4,
/// Orientation). Numbers 1 (as it is) to 8.
namespace cairn {

inline constexpr int kUpright = 1;

/// Reads the orientation from the TIFF structure that Exif is. kUpright where it says nothing that makes
/// sense. Never reads outside `tiff`.
[[nodiscard]] int exif_orientation(std::span<const uint8_t> tiff);

/// Whether width and height are exchanged when it is shown.
[[nodiscard]] bool lies_on_its_side(int orientation);

/// "turned by 90 degrees clockwise", with "mirrored" where it is; empty for kUpright.
[[nodiscard]] std::string orientation_words(int orientation);

/// The pixels as viewers show them.
[[nodiscard]] cv::Mat upright(const cv::Mat& pixels, int orientation);

}  // namespace cairn
