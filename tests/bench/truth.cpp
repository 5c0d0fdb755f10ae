// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/truth.h"

#include <cmath>
#include <iterator>

namespace cairn {
namespace {

constexpr double kTruthTolerance = 0.012;  // [s] between a frame and its row of truth
// [s] between two rows: a hand moves evenly for so long, to a few millimetres.
constexpr double kLongestGap = 0.15;

}  // namespace

Truth::Truth(const Trajectory& trajectory) {
  for (const auto& segment : trajectory.segments) {
    for (const StampedPose& p : segment.poses) poses_[p.time] = p.map_from_camera;
  }
}

const SE3* Truth::at(Timestamp time) const {
  const SE3* best = nullptr;
  double nearest = kTruthTolerance;
  auto it = poses_.lower_bound(time);
  if (it != poses_.begin()) --it;
  for (int i = 0; i < 2 && it != poses_.end(); ++i, ++it) {
    const double off = std::abs(seconds_between(it->first, time));
    if (off > nearest) continue;
    nearest = off;
    best = &it->second;
  }
  return best;
}

std::optional<SE3> Truth::interpolated(Timestamp time) const {
  if (const SE3* exact = at(time)) return *exact;
  const auto after = poses_.lower_bound(time);
  if (after == poses_.begin() || after == poses_.end()) return std::nullopt;
  const auto before = std::prev(after);
  const double gap = seconds_between(after->first, before->first);
  if (gap > kLongestGap) return std::nullopt;
  const double share = seconds_between(time, before->first) / gap;
  return SE3(before->second.rotation().slerp(share, after->second.rotation()),
             (1 - share) * before->second.translation() + share * after->second.translation());
}

Result<Similarity3> align(const std::vector<StampedPose>& poses, const Truth& truth) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const StampedPose& p : poses) {
    const SE3* exact = truth.at(p.time);
    if (exact == nullptr) continue;
    from.push_back(p.map_from_camera.translation());
    to.push_back(exact->translation());
  }
  return align_points(from, to, true);
}

Offset compare(const Similarity3& truth_from_map, const SE3& camera_from_map, const SE3& exact) {
  const SE3 found = truth_from_map.transform_camera(camera_from_map);
  return {(found.center() - exact.translation()).norm(),
          so3_log((found * exact).rotation()).norm() * 180 / M_PI};
}

}  // namespace cairn
