// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/scene_depth.h"

#include <algorithm>
#include <span>

#include "common/base/median.h"

namespace cairn {

template <typename T>
double scene_depth(std::vector<T>* depths) {
  constexpr double kFarthest = 4;  // medians; things on a desk and the wall behind it are nearer
  if (depths->empty()) return 0;
  const double most = kFarthest * static_cast<double>(reorder_to_median(std::span(*depths)));
  double sum = 0;
  for (const T depth : *depths) sum += std::min(static_cast<double>(depth), most);
  return sum / static_cast<double>(depths->size());
}

template double scene_depth(std::vector<float>*);
template double scene_depth(std::vector<double>*);

}  // namespace cairn
