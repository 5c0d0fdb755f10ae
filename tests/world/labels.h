// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "tests/world/simulator.h"

/// What the wearer labels while places are mapped, and the labels that came of it.
namespace cairn {

/// A thing of a place that has the place's name as its label.
struct LabelTruth {
  std::string place;      ///< name, and the label's text
  Eigen::Vector3d point;  ///< in the place's frame [m], exact
};

/// A thing to label, and where the wearer points at it.
struct LabelTarget {
  LabelTruth thing;
  Timestamp time;         ///< of the frame in which it is pointed at
  Eigen::Vector2i pixel;  ///< of that frame
};

/// Chooses one target for each place that is mapped, when three quarters of its phase are over: of the
/// stronger half of the image's corners the one nearest to its middle that is of the place and on a surface,
/// not at the edge of a thing. Later in the phase where that frame has none.
[[nodiscard]] std::vector<LabelTarget> choose_label_targets(Simulator* simulator);

/// Writes `labels.txt`, which `cairn-track --labels` reads, and `label_truth.txt`. Error kIo.
[[nodiscard]] Status write_label_targets(const std::filesystem::path& directory,
                                         const std::vector<LabelTarget>& targets);
/// Reads `label_truth.txt`. Errors name file and line: kNotFound, kIo, kDamaged.
[[nodiscard]] Result<std::vector<LabelTruth>> read_label_truth(const std::filesystem::path& directory);

/// A label in a map.
struct PlacedLabel {
  std::string map;  ///< name
  std::string text;
  Eigen::Vector3d position;  ///< in the map
};
/// Reads the output of `cairnctl --json labels`. Errors name the file: kNotFound, kIo, kDamaged.
[[nodiscard]] Result<std::vector<PlacedLabel>> read_placed_labels(const std::filesystem::path& path);

}  // namespace cairn
