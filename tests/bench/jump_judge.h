// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "common/base/result.h"

/// A camera that jumps between mapped places: the list of jumps, and what came of each.
namespace cairn {

struct Jump {
  std::string place;
  uint64_t first_frame = 0;  ///< of the recording of that place
};
/// Rows `place first_frame ...`; `#` begins a comment. kDamaged names the row that is none.
[[nodiscard]] Result<std::vector<Jump>> parse_jumps(std::string_view text);

/// What a tracker said of one frame after a jump.
struct SeenFrame {
  enum class Pose : uint8_t { kNone, kVerifying, kPublished };
  Pose pose = Pose::kNone;
  bool right_map = false;
  bool right_pose = false;  ///< in the right map, and near the truth
};

/// Frames count from 0, the first after the jump.
struct JumpOutcome {
  /// The first pose, published or not, that is right and is verified by what follows: every frame from it
  /// to the first published one has a right pose.
  std::optional<size_t> right;
  std::optional<size_t> published;  ///< the first pose published that is right
  size_t wrong_map = 0;             ///< frames with a pose published in another map
  size_t wrong_pose = 0;            ///< frames with a pose published in the right map that is not right
  size_t without = 0;               ///< frames without a published pose
};
[[nodiscard]] JumpOutcome judge_jump(std::span<const SeenFrame> frames);

}  // namespace cairn
