// SPDX-License-Identifier: Apache-2.0
#include "client/relocalization/verified_path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace cairn {
namespace {

struct Place {
  double back = 0;  ///< [s] before the latest
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
};

/// The path, the latest first.
using Places = std::span<const Place>;

/// The first that is so much older than that of index `i`.
std::optional<size_t> before(Places path, size_t i, double lag) {
  for (size_t k = i + 1; k < path.size(); ++k) {
    if (path[k].back - path[i].back >= lag) return k;
  }
  return std::nullopt;
}

/// The variance, per axis, of a place predicted `seconds` [s] ahead by the mean velocity over the last `lag`
/// [s], if the acceleration is white noise of density 1.
double variance_of(double seconds, double lag) {
  return seconds * seconds * (seconds + lag) / 3;
}

/// Density of the acceleration, of three axes together [map unit^2/s^3], by what constant velocity missed at
/// index `i`.
std::optional<double> density_at(Places path, size_t i, double lag) {
  const auto middle = before(path, i, lag);
  const auto first = middle ? before(path, *middle, lag) : std::nullopt;
  if (!first) return std::nullopt;
  const double seconds = path[*middle].back - path[i].back;
  const double span = path[*first].back - path[*middle].back;
  const Eigen::Vector3d velocity = (path[*middle].centre - path[*first].centre) / span;
  const Eigen::Vector3d missed = path[i].centre - path[*middle].centre - seconds * velocity;
  return missed.squaredNorm() / variance_of(seconds, span);
}

/// Density of the acceleration: the mean along the path, or the newest if that is more, for a camera that
/// begins to hurry goes on so.
std::optional<double> density_of(Places path, double lag) {
  const auto newest = density_at(path, 0, lag);
  if (!newest) return std::nullopt;
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < path.size(); ++i, ++count) {
    const auto density = density_at(path, i, lag);
    if (!density) break;
    sum += *density;
  }
  return std::max(*newest, sum / static_cast<double>(count));
}

}  // namespace

void VerifiedPath::add(const AnchoredPose& pose, Timestamp time) {
  const bool is_close = count_ >= 2 && std::abs(seconds_between(time, entry(1).time)) < options_.spacing;
  if (is_close) next_ = (next_ + kMost - 1) % kMost;
  entries_[next_] = {pose, time};
  next_ = (next_ + 1) % kMost;
  if (!is_close) count_ = std::min(count_ + 1, kMost);
}

std::optional<SE3> VerifiedPath::last(const MapSnapshot& map) const {
  return count_ == 0 ? std::nullopt : pose_in(map, entry(0).pose);
}

std::optional<ReachableRegion> VerifiedPath::reachable(const MapSnapshot& map, Timestamp time) const {
  std::array<Place, kMost> places;
  size_t count = 0;
  for (; count < count_; ++count) {
    const double seconds = seconds_between(entry(0).time, entry(count).time);
    const auto pose = pose_in(map, entry(count).pose);
    if (!pose || seconds < 0 || seconds > options_.window + 2 * options_.lag) break;
    places[count] = {seconds, pose->center()};
  }
  const Places path = std::span(places).first(count);
  if (path.empty() || path.back().back < options_.shortest) return std::nullopt;
  const double seconds = seconds_between(time, entry(0).time);
  const double lag = std::min(options_.lag, path.back().back / 2 - options_.spacing);
  if (lag <= 0) return std::nullopt;  // no two velocities
  const auto earlier = before(path, 0, lag);
  const auto density = density_of(path, lag);
  if (seconds < 0 || !earlier || !density) return std::nullopt;
  const double span = path[*earlier].back;
  const Eigen::Vector3d velocity = (path[0].centre - path[*earlier].centre) / span;
  const double sigma = std::sqrt(*density / 3 * variance_of(seconds, span));
  return ReachableRegion{path[0].centre + seconds * velocity, options_.sigmas * sigma};
}

}  // namespace cairn
