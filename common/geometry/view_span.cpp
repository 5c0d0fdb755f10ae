// SPDX-License-Identifier: Apache-2.0
#include "common/geometry/view_span.h"

#include <algorithm>

namespace cairn {
namespace {

constexpr double kYoungSpan = 0.1;  // of the depth
constexpr double kWidening = 1.5;   // times the span

}  // namespace

bool widens_young_map(std::span<const Eigen::Vector3d> centers, const Eigen::Vector3d& center,
                      double mean_depth) {
  if (centers.size() < 2 || centers.size() > kMostYoungViews) return false;
  double span = 0;
  double reach = 0;
  for (size_t i = 0; i < centers.size(); ++i) {
    reach = std::max(reach, (centers[i] - center).norm());
    for (size_t j = 0; j < i; ++j) span = std::max(span, (centers[i] - centers[j]).norm());
  }
  return span < kYoungSpan * mean_depth && reach > kWidening * span;
}

}  // namespace cairn
