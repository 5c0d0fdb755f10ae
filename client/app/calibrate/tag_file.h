// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <map>

#include "common/base/result.h"

namespace cairn {

/// The places of tags on a board.
struct TagPlan {
  /// Corners in the plane z = 0 [any unit], clockwise as one looks at the tag.
  std::map<int, std::array<Eigen::Vector3d, 4>> tags;
  /// Width of the tags' black border that is looked for first [bits].
  int border = 1;
};

/// Reads a JSON object of tag id -> four corners [x, y, 0], or the yaml of Kalibr's Aprilgrid (target_type
/// aprilgrid, tagCols, tagRows, tagSize, tagSpacing; tag 0 is in the lower left). Errors name the file and
/// what was expected: kNotFound, kIo, kConfiguration.
[[nodiscard]] Result<TagPlan> read_tag_plan(const std::filesystem::path& path);

}  // namespace cairn
