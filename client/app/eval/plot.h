// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "client/app/eval/metrics.h"
#include "common/base/result.h"

namespace cairn {

/// A trajectory plot: left the paths seen along the axis in which the truth spreads least, right the error
/// over time.
struct PlotContent {
  std::string title;
  std::string error_name;                           ///< of the right panel's vertical axis, without its unit
  std::vector<StampedPose> truth;                   ///< in time order
  std::vector<std::vector<StampedPose>> estimates;  ///< one per map, aligned to the truth, in time order
  std::vector<TimedError> errors;                   ///< in time order [m]
  double rmse = 0;                                  ///< [m], drawn as a line
};

/// Draws a PNG of 1600x760 pixels. Error kIo when it cannot be written.
[[nodiscard]] Status write_plot(const std::filesystem::path& path, const PlotContent& content);

}  // namespace cairn
