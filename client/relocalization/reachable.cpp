// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/reachable.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kSigmas = 3;  ///< of the suggested pose, that count for it
/// What a place must have before its rivals in the server's comparison, too (RelocOptions::least_margin).
constexpr double kClearly = 1.25;

/// The nearest of what lies between standing still and going on as before.
Eigen::Vector3d nearest_on_the_way(const ProvenMotion& from, double seconds, const Eigen::Vector3d& to) {
  const Eigen::Vector3d begin = from.camera_from_map.center();
  const Eigen::Vector3d way = seconds * from.velocity;
  const double squared = way.squaredNorm();
  if (!(squared > 0)) return begin;
  return begin + std::clamp((to - begin).dot(way) / squared, 0.0, 1.0) * way;
}

}  // namespace

Reach reach(const ProvenMotion& from, const SuggestedPose& to, const HandMotion& hand) {
  const double seconds = seconds_between(to.time, from.time);
  if (seconds < 0) return {.is_reachable = true};
  const double changed = 0.5 * seconds * seconds;
  const Eigen::Vector3d centre = to.camera_from_map.center();
  const Eigen::Vector3d off = centre - nearest_on_the_way(from, seconds, centre);
  const double distance = off.norm();
  const double sigma = distance > 0 ? std::sqrt(std::max(0.0, off.dot(to.covariance * off))) / distance : 0.0;
  const double too_far =
      (distance - kSigmas * sigma) / std::max(from.depth, 1e-9) - hand.acceleration * changed;
  const double turned = from.camera_from_map.rotation().angularDistance(to.camera_from_map.rotation());
  const double turned_too_far = turned - from.turn_rate * seconds - hand.turn_acceleration * changed;
  const double beyond = std::max(0.0, too_far) + std::max(0.0, turned_too_far);
  return {.is_reachable = beyond <= 0, .beyond = beyond, .needed_margin = beyond > 0 ? kClearly : 1.0};
}

}  // namespace cairn
