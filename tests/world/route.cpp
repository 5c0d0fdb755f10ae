// SPDX-License-Identifier: Apache-2.0
#include "tests/world/route.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace cairn {
namespace {

constexpr double kWalkingSpeed = 1.5;  // m/s
constexpr double kSidlingSpeed = 0.5;

CameraPtr make_carried_camera(Carrier carrier) {
  const CameraParameters hand{
      CameraModel::kPinholeRadtan, 640, 480, {502.3, 501.7, 321.4, 238.2, -0.18, 0.055, 0.0006, -0.0004, 0}};
  const CameraParameters shoulder{
      CameraModel::kPinholeRadtan, 640, 480, {408.9, 409.6, 316.8, 243.5, -0.24, 0.08, -0.0003, 0.0005, 0}};
  const auto camera = make_camera(carrier == Carrier::kHand ? hand : shoulder);
  if (!camera) throw std::logic_error(camera.error().message);
  return *camera;
}

/// What the camera on the shoulder sees while the hand does this: from behind and above, turning with the
/// body only.
std::vector<Waypoint> on_shoulder(const std::vector<Waypoint>& hand) {
  std::vector<Waypoint> shoulder;
  const auto count = static_cast<int>(hand.size());
  for (int i = 0; i < count; ++i) {
    Waypoint mean{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
    constexpr int kReach = 2;
    for (int j = i - kReach; j <= i + kReach; ++j) {
      const Waypoint& near = hand[static_cast<size_t>(std::clamp(j, 0, count - 1))];
      mean.eye += near.eye / (2 * kReach + 1);
      mean.target += near.target / (2 * kReach + 1);
    }
    Eigen::Vector3d ahead = mean.target - mean.eye;
    ahead.z() = 0;
    ahead.normalize();
    const Eigen::Vector3d right = ahead.cross(Eigen::Vector3d::UnitZ());
    shoulder.push_back({mean.eye - 0.24 * ahead + 0.12 * right + Eigen::Vector3d(0, 0, 0.2), mean.target});
  }
  return shoulder;
}

Waypoint seen_from(const SE3& map_from_place, double scale, Waypoint view, Random& random) {
  for (int axis = 0; axis < 3; ++axis) {
    view.eye[axis] += 0.03 * random.normal();
    view.target[axis] += 0.025 * random.normal();
  }
  return {map_from_place * (scale * view.eye), map_from_place * (scale * view.target)};
}

}  // namespace

void RouteBuilder::add(PhaseKind kind, int place, std::span<const Waypoint> waypoints) {
  // The spline is at a waypoint one interval before the next: a stay ends where its last one is reached, and
  // turning away belongs to the walk.
  const int intervals = kind == PhaseKind::kWalk && !phases_.empty() ? 2 : 1;
  const double begin = std::max(now() - intervals * kWaypointInterval, 0.0);
  if (!phases_.empty()) phases_.back().end = begin;
  phases_.push_back({kind, place, begin, 0});
  route_.insert(route_.end(), waypoints.begin(), waypoints.end());
}

void RouteBuilder::close(Carrier carrier, Scenario* scenario) && {
  phases_.back().end = now();
  scenario->carrier = carrier;
  scenario->camera = make_carried_camera(carrier);
  scenario->vignetting = 0.6;
  scenario->route = carrier == Carrier::kHand ? std::move(route_) : on_shoulder(route_);
  scenario->phases = std::move(phases_);
}

void RouteBuilder::finish(Carrier carrier, Scenario* scenario) && {
  const Waypoint rest = last();
  const double end = now();
  route_.insert(route_.end(), 4, rest);  // what the spline looks ahead to
  std::move(*this).close(carrier, scenario);
  scenario->phases.back().end = end;
  scenario->endless = false;
}

std::vector<Waypoint> survey(const SE3& map_from_place, double scale, Random& random) {
  const Waypoint start{{-0.05, -0.70, 0.44}, {-0.02, 0.08, 0.06}};
  const std::array<Waypoint, 8> stations = {{{{-0.38, -0.58, 0.42}, {-0.30, 0.06, 0.05}},
                                             {{-0.34, -0.46, 0.36}, {-0.34, 0.16, 0.12}},
                                             {{-0.06, -0.46, 0.42}, {-0.06, 0.20, 0.16}},
                                             {{0.30, -0.50, 0.38}, {0.28, 0.12, 0.10}},
                                             {{0.40, -0.56, 0.44}, {0.34, 0.06, 0.05}},
                                             {{0.12, -0.52, 0.56}, {0.06, 0.02, 0.00}},
                                             {{-0.16, -0.56, 0.50}, {-0.10, 0.06, 0.04}},
                                             {{0.02, -0.72, 0.46}, {0.02, 0.10, 0.06}}}};
  std::vector<Waypoint> route;
  const Waypoint begin = seen_from(map_from_place, scale, start, random);
  const Eigen::Vector3d aside = map_from_place.rotation() * Eigen::Vector3d(0.15 * scale, 0, 0);
  for (const double part : {0.0, 0.0, 0.6, 1.0, 0.5}) {
    route.push_back({begin.eye + part * aside, begin.target + 0.5 * part * aside});
  }
  for (const Waypoint& station : stations) {
    route.push_back(seen_from(map_from_place, scale, station, random));
  }
  return route;
}

std::vector<Waypoint> glance(const SE3& map_from_place, double scale, Random& random) {
  const double side = random.uniform(-0.2, 0.2);
  const Waypoint first{{side, -0.70, random.uniform(0.40, 0.52)}, {0.4 * side, 0.10, 0.07}};
  const Waypoint second{{0.4 * side, -0.58, 0.46}, {-0.6 * side, 0.10, 0.07}};
  std::vector<Waypoint> route;
  for (const double part : {0.0, 0.0, 0.5, 1.0, 1.0}) {
    route.push_back(seen_from(
        map_from_place, scale,
        {first.eye + part * (second.eye - first.eye), first.target + part * (second.target - first.target)},
        random));
  }
  return route;
}

std::vector<Waypoint> walk(const Waypoint& from, std::span<const Eigen::Vector3d> through, const Waypoint& to,
                           Walks how, Random& random) {
  std::vector<Eigen::Vector3d> line = {from.eye};
  line.insert(line.end(), through.begin(), through.end());
  line.push_back(to.eye);
  double length = 0;
  for (size_t i = 1; i < line.size(); ++i) length += (line[i] - line[i - 1]).norm();
  const auto point_at = [&line](double distance) {
    for (size_t i = 1; i < line.size(); ++i) {
      const Eigen::Vector3d leg = line[i] - line[i - 1];
      if (distance <= leg.norm() || i + 1 == line.size()) {
        return Eigen::Vector3d(line[i - 1] + std::min(distance / std::max(leg.norm(), 1e-9), 1.0) * leg);
      }
      distance -= leg.norm();
    }
    return line.back();
  };
  const double step = (how == Walks::kSlow ? kSidlingSpeed : kWalkingSpeed) * kWaypointInterval;
  const int count = std::max(3, static_cast<int>(std::lround(length / step)));
  std::vector<Waypoint> route;
  for (int i = 1; i < count; ++i) {
    const double distance = length * i / count;
    Waypoint view{point_at(distance), point_at(std::min(distance + 1.2, length))};
    Eigen::Vector3d ahead = view.target - view.eye;
    if (ahead.head<2>().norm() < 0.3) ahead = to.target - view.eye;  // nearly there
    // Drawn one after the other: the order in which arguments are evaluated differs between processors.
    const double up = 0.02 * random.normal();
    const double forward = 0.03 * random.normal();
    const double aside = 0.03 * random.normal();
    view.eye += Eigen::Vector3d(aside, forward, up);
    if (how == Walks::kSlow) {
      const double part = static_cast<double>(i) / count;
      view.target = view.eye + (1 - part) * (from.target - from.eye) + part * (to.target - to.eye);
    } else {
      const double target_forward = 0.15 * random.normal();
      const double target_aside = 0.15 * random.normal();
      view.target =
          view.eye + 1.5 * ahead.normalized() + Eigen::Vector3d(target_aside, target_forward, -0.55);
    }
    route.push_back(view);
  }
  return route;
}

}  // namespace cairn
