// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

namespace cairn {

/// Order of file names in which runs of digits count by value: frame2 < frame10. A strict total order.
[[nodiscard]] bool natural_less(std::string_view a, std::string_view b);

/// Whether a file is one that a system leaves beside images: `._a.jpg` of a Mac, and every other hidden file.
[[nodiscard]] bool is_hidden(const std::filesystem::path& path);

/// Images whose names are one but for their numbers.
struct ImageKind {
  std::string pattern;                       ///< of the names, '*' for each number: "f-*.color.jpg"
  std::vector<std::filesystem::path> files;  ///< in natural order
};

/// The kinds in a folder that holds several recordings side by side (colour and depth, left and right,
/// masks): those of two files or more of which at least half have the numbers of the largest kind. Empty
/// where there is one recording. `names` in natural order.
[[nodiscard]] std::vector<ImageKind> kinds_side_by_side(const std::vector<std::filesystem::path>& paths);

struct ImageFolder {
  std::vector<std::filesystem::path> files;  ///< in natural order, at least one
  size_t hidden = 0;                         ///< left out
};

/// The png, jpg, jpeg, pgm and ppm files of a folder whose names match the glob, if there is one (`*`,
/// `[0-9]`; case does not matter). Errors name the folder: kNotFound (no folder, no image), kIo,
/// kConfiguration: without a glob, images of several kinds.
[[nodiscard]] Result<ImageFolder> list_images(const std::filesystem::path& directory,
                                              const std::optional<std::string>& glob);

}  // namespace cairn
