// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace cairn {

/// Views beyond this many span enough: who has more need not ask.
constexpr size_t kMostYoungViews = 16;

/// Whether a view from `center` brings parallax that a young map needs: its views, from `centers`, span less
/// than a tenth of the depth, and with this one half as much again as they do. A map begun with little
/// parallax knows its depths badly, and this is what mends them; the steps grow with the span, so a handful
/// of views leads from the least start to a tenth of the depth. One view is no start. Lengths in one unit.
[[nodiscard]] bool widens_young_map(std::span<const Eigen::Vector3d> centers, const Eigen::Vector3d& center,
                                    double mean_depth);

}  // namespace cairn
