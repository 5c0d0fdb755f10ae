// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/camera.h"
#include "common/io/image_file.h"

namespace cairn {

/// How often each value occurs in images with more than 8 bits.
using DeepHistogram = std::vector<uint64_t>;

/// The grey levels that such images use: 0 to what the least number of bits holds (10, 12 or 14 bits of a
/// sensor in files of 16); where they use less than a quarter of those, as heat cameras do, the part that
/// they use with half of it on either side. Nothing where all 16 bits are used, and for an empty histogram.
/// Values of one in a thousand pixels at either end are taken for faults of the sensor.
[[nodiscard]] std::optional<GrayLevels> used_levels(const DeepHistogram& histogram);

/// Whether pixels are smoother with their bytes exchanged: some write PGM files with the low byte first.
[[nodiscard]] bool has_exchanged_bytes(const DeepImage& image);

/// The properties that the images of a recording have in common.
struct ImageSample {
  std::optional<ImageSize> size;     ///< of most, as they are shown; nothing where none can be read
  std::set<int> orientations;        ///< of those of that size (orientation.h)
  std::optional<GrayLevels> levels;  ///< for images with more than 8 bits, the same for all
};

/// Looks at a few images, spread evenly. Takes as long as reading nine, as a rule.
[[nodiscard]] ImageSample sample_images(std::span<const std::filesystem::path> paths);

}  // namespace cairn
