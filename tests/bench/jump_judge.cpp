// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/jump_judge.h"

#include <sstream>
#include <string>

#include "common/io/text.h"

namespace cairn {

Result<std::vector<Jump>> parse_jumps(std::string_view text) {
  std::vector<Jump> jumps;
  for (const TextLine& line : data_lines(text)) {
    std::istringstream row{std::string(line.text)};
    Jump jump;
    if (!(row >> jump.place >> jump.first_frame))
      return fail(ErrorCode::kDamaged, "no jump: " + std::string(line.text));
    jumps.push_back(std::move(jump));
  }
  return jumps;
}

JumpOutcome judge_jump(std::span<const SeenFrame> frames) {
  JumpOutcome outcome;
  std::optional<size_t> run;  // since when every frame has had a right pose
  for (size_t i = 0; i < frames.size(); ++i) {
    const SeenFrame& frame = frames[i];
    const bool is_published = frame.pose == SeenFrame::Pose::kPublished;
    const bool is_right = frame.pose != SeenFrame::Pose::kNone && frame.right_map && frame.right_pose;
    outcome.without += is_published ? 0 : 1;
    outcome.wrong_map += is_published && !frame.right_map ? 1 : 0;
    outcome.wrong_pose += is_published && frame.right_map && !frame.right_pose ? 1 : 0;
    if (!is_right) {
      run.reset();
      continue;
    }
    if (!run) run = i;
    if (!is_published || outcome.published) continue;
    outcome.published = i;
    outcome.right = run;
  }
  return outcome;
}

}  // namespace cairn
