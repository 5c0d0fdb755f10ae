// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/app/eval/metrics.h"
#include "common/base/result.h"
#include "common/io/trajectory.h"

namespace cairn {

/// A trajectory to be compared, and what a person must know of how it was read.
struct ReadTrajectory {
  Trajectory trajectory;
  std::vector<std::string> notes;
};

/// read_trajectory(), with a note on rows that were left out.
[[nodiscard]] Result<ReadTrajectory> read_estimate(const std::filesystem::path& path);

/// Reads the truth as read_estimate() does, and turns rows of the body (EuRoC, TUM-VI) into those of the
/// camera: with T_BS of the sensor.yaml beside the file (the sensor's whose poses they are, or the camera's),
/// and of `../cam0/sensor.yaml`, as EuRoC lays out its folders. Without the camera's they are the body's, and
/// a note says so.
[[nodiscard]] Result<ReadTrajectory> read_truth(const std::filesystem::path& path);

/// Evidence that a file which was read as x y z w has its quaternions' w first.
struct QuaternionDoubt {
  bool in_truth = true;  ///< else in the estimate
  double as_read = 0;    ///< how far the turns of truth and estimate differ [rad], the median
  double w_first = 0;    ///< the same with the other order
};

/// Looks whether truth and estimate turn much more alike with the w of one of them first. Which frame the
/// poses are of, and which worlds, does not matter: only a constant turn between the two is fitted. Nothing
/// where they agree as they are, or turn too little to tell.
[[nodiscard]] std::optional<QuaternionDoubt> doubt_quaternions(const Comparison& comparison);

/// The doubt in words, with the command that puts w last in `file`.
[[nodiscard]] std::string words_of(const QuaternionDoubt& doubt, const std::string& file);

}  // namespace cairn
