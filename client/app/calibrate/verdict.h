// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "client/app/calibrate/solver.h"

namespace cairn {

enum class Grade { kGood, kUsable, kPoor };

/// How good a calibration is, and what would make it better.
struct Verdict {
  Grade grade = Grade::kPoor;
  int views = 0;                    ///< that count
  double coverage = 0;              ///< part of the image's 6x4 cells in which a board point was measured
  double focal_sigma = 0;           ///< of the less certain focal length, relative
  double largest_tilt = 0;          ///< of the board against the image plane [rad]
  std::vector<std::string> advice;  ///< sentences; empty for a good one
};

/// good: rms within 0.08 % of the image's width (0.5 px of 640), focal length within 0.3 % (sigma), 80 %
/// coverage, 10 views; usable: 0.2 %, 1.5 %, 50 %, 5 views; else poor.
[[nodiscard]] Verdict judge(const BoardCalibration& calibration, const std::vector<BoardView>& views);

/// good, usable, poor.
[[nodiscard]] std::string_view name_of(Grade grade);

}  // namespace cairn
