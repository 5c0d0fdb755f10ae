// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace cairn {

/// How far away a scene is: the mean of its depths [any unit, positive], none counted as more than four
/// medians. A point too far to be measured stands wherever noise has put it, a thousand times as far or ten
/// thousand; how far a camera must move to see something new is for the others to say. 0 for none. Reorders
/// the depths.
template <typename T>
[[nodiscard]] double scene_depth(std::vector<T>* depths);

extern template double scene_depth(std::vector<float>*);
extern template double scene_depth(std::vector<double>*);

}  // namespace cairn
