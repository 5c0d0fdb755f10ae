// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "common/map/snapshot.h"
#include "server/mapping/free_camera.h"

/// Cameras that are found out in a map, while it grows.
namespace cairn {

/// How well a camera is known that comes with a seed or an offer.
struct CameraDoubt {
  CameraVersion version;  ///< of the values given
  Intrinsics sigma = Intrinsics::Zero();
};

struct MapCamera {
  CameraVersion version;  ///< of `published`
  CameraPtr camera;       ///< as of the last adjustment: what the map's keyframes have
  Intrinsics sigma = Intrinsics::Zero();
  Intrinsics prior_mean = Intrinsics::Zero();
  Intrinsics prior_sigma = Intrinsics::Zero();
  bool frozen = false;  ///< known well enough: no longer adjusted

  Intrinsics judged = Intrinsics::Zero();    ///< the estimate before, of fewer keyframes
  size_t judged_keyframes = 0;               ///< its number of keyframes
  int agreements = 0;                        ///< successive estimates, of more and more keyframes, that agree
  Intrinsics searched = Intrinsics::Zero();  ///< under which points were searched that are given up

  CameraPtr published;
  Intrinsics published_sigma = Intrinsics::Zero();
  bool published_frozen = false;
  bool published_unknown = false;  ///< that it cannot be known
};

[[nodiscard]] MapCamera make_map_camera(const CameraPtr& camera, const CameraDoubt& doubt);

/// Takes in what an adjustment of so many keyframes found. Freezes a camera that is known well enough: sigma
/// small, by enough keyframes, and successive estimates agree.
void update(MapCamera* camera, const FreeCamera& adjusted, size_t keyframes);
/// Whether there were keyframes enough, and still the focal length is not known.
[[nodiscard]] bool cannot_be_known(const MapCamera& camera);
/// True when the camera has moved from the values under which points were searched by what a search feels;
/// from now on these count as searched with.
bool take_move(MapCamera* camera);

/// What it is now counts as published.
void count_as_published(MapCamera* camera);
/// Makes a new version if the values have changed by what can be seen, if they are known notably better, or
/// were frozen. Whether the values of the new version differ visibly.
enum class Publication : uint8_t { kNone, kKnownBetter, kMoved };
Publication publish(MapCamera* camera);

}  // namespace cairn
