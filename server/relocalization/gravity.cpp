// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/gravity.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace cairn {
namespace {

bool agree(const UpDirection& a, const UpDirection& b, const GravityOptions& options) {
  const double angle = angle_between(a, b);
  return angle * angle <=
         options.chi_square * (a.sigma * a.sigma + b.sigma * b.sigma + options.pose_tilt * options.pose_tilt);
}

std::optional<UpDirection> mean_of(std::span<const UpDirection> all, double common_sigma) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0;
  for (const UpDirection& one : all) {
    const double weight = 1 / (one.sigma * one.sigma);
    sum += weight * one.up;
    weights += weight;
  }
  if (!(sum.norm() > 0)) return std::nullopt;
  return UpDirection{sum.normalized(), std::max(common_sigma, std::sqrt(1 / weights))};
}

}  // namespace

std::optional<UpDirection> up_in_map(const MapSnapshot& snapshot, std::span<const KeyframeView> views,
                                     const GravityOptions& options) {
  std::vector<UpDirection> all;
  for (const KeyframeView& view : views) {
    const KeyframePose* keyframe = view.up ? snapshot.find(view.id) : nullptr;
    if (keyframe != nullptr)
      all.push_back(turned(keyframe->camera_from_map.rotation().conjugate(), *view.up));
  }
  const auto first = mean_of(all, options.common_sigma);
  if (!first) return std::nullopt;
  const auto is_other = [&](const UpDirection& one) { return !agree(one, *first, options); };
  const auto others = std::erase_if(all, is_other);
  if (static_cast<double>(others) > options.most_contradict * static_cast<double>(all.size() + others))
    return std::nullopt;
  return mean_of(all, options.common_sigma);
}

bool is_upright(const SE3& camera_from_map, const std::optional<UpDirection>& in_map,
                const std::optional<UpDirection>& seen, const GravityOptions& options) {
  return !in_map || !seen || agree(turned(camera_from_map.rotation(), *in_map), *seen, options);
}

}  // namespace cairn
