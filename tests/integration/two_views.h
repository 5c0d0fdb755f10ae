// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/tracking/tracker.h"
#include "common/map/snapshot.h"
#include "server/mapping/test_scene.h"

/// What a tracker would send of the map maker's test scene: a seed of two views, and frames offered as
/// keyframes.
namespace cairn::testing {

constexpr int kFirstView = 0;  ///< of Scene::pose()
constexpr int kSecondView = 2;

/// Two views with trails at corners of the first, exact to rounding.
[[nodiscard]] SeedProposal make_seed(const Scene& scene);
/// Two views from one place: no map can come of them.
[[nodiscard]] SeedProposal make_seed_without_parallax(const Scene& scene);

struct Frame {
  KeyframeProposal proposal;
  GrayImagePtr image;
};
/// View `step` tracked against a map that was made from make_seed(): its true pose and the map's points where
/// they appear.
[[nodiscard]] Frame make_offer(const Scene& scene, const MapSnapshot& map, int step);

}  // namespace cairn::testing
