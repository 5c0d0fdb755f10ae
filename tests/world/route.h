// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "tests/world/random.h"
#include "tests/world/scenario.h"

namespace cairn {

/// Strings together what the wearer does, as waypoints of the hand.
class RouteBuilder {
 public:
  void add(PhaseKind kind, int place, std::span<const Waypoint> waypoints);
  /// The waypoint that was added last. Precondition: there is one.
  [[nodiscard]] const Waypoint& last() const { return route_.back(); }
  [[nodiscard]] bool empty() const { return route_.empty(); }
  /// Seconds on the clock of the route until what is added next.
  [[nodiscard]] double now() const { return static_cast<double>(route_.size()) * kWaypointInterval; }

  /// Gives the scenario route, phases and camera; the route ends where it began and goes on for ever.
  void close(Carrier carrier, Scenario* scenario) &&;
  /// As close(), but the route ends.
  void finish(Carrier carrier, Scenario* scenario) &&;

 private:
  std::vector<Waypoint> route_;
  std::vector<Phase> phases_;
};

/// Waypoints in front of a place and around it, as of one who makes a map: aside, left, right, close, from
/// above. The place is about a metre wide times `scale`, about the origin of its frame, seen from its -y.
[[nodiscard]] std::vector<Waypoint> survey(const SE3& map_from_place, double scale, Random& random);

/// Waypoints of a look at a place by one who comes by.
[[nodiscard]] std::vector<Waypoint> glance(const SE3& map_from_place, double scale, Random& random);

/// Waypoints of a walk along a line of points (eye height), from a waypoint to the first of what comes next.
/// The wearer looks ahead and down; or goes slowly, turning only from the first view to the last.
[[nodiscard]] std::vector<Waypoint> walk(const Waypoint& from, std::span<const Eigen::Vector3d> through,
                                         const Waypoint& to, Walks how, Random& random);

}  // namespace cairn
