// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {

/// A label that somebody would put at a pixel of the frame of that time.
struct TimedLabel {
  Timestamp time;
  cv::Point pixel;
  std::string text;
};

/// Rows `timestamp x y text` (the text is the rest of the row), '#' begins a comment; in order of time.
/// Errors name file and line: kNotFound, kIo, kDamaged (also a pixel outside an image of this size, and a
/// text that nobody could type).
[[nodiscard]] Result<std::vector<TimedLabel>> read_timed_labels(const std::filesystem::path& path,
                                                                cv::Size image);

}  // namespace cairn
