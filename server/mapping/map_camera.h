// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "common/bundle/free_camera.h"
#include "common/map/snapshot.h"
#include "server/mapping/map_maker_options.h"

/// Self-calibration: cameras that are calibrated in a map, while it grows.
namespace cairn {

/// The intrinsics prior of a camera that comes with a seed or an offer.
struct CameraPrior {
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

  Intrinsics judged = Intrinsics::Zero();  ///< the estimate that those after it agreed with
  size_t judged_keyframes = 0;             ///< ever made when it was
  int agreements = 0;                      ///< successive estimates, of more and more keyframes, that agree
  /// Under which points were searched that are given up, and rays of patches aimed.
  Intrinsics searched = Intrinsics::Zero();

  CameraPtr published;
  Intrinsics published_sigma = Intrinsics::Zero();
  bool published_frozen = false;
  bool published_unknown = false;  ///< that it cannot be known
};

/// Keyframes of a camera.
struct KeyframeCount {
  size_t live = 0;
  size_t made = 0;  ///< ever, removed ones included
};

[[nodiscard]] MapCamera make_map_camera(const CameraPtr& camera, const CameraPrior& prior);

/// Whether enough is new to look for other focal lengths and to say how well it is known: both take several
/// adjustments. At first that is any keyframe; once many have not told it, a quarter more of them.
[[nodiscard]] bool is_worth_judging(const MapCamera& camera, const KeyframeCount& keyframes,
                                    const SelfCalibrationOptions& options);
/// Takes in what an adjustment of these keyframes found. Freezes a camera that is known well enough: sigma
/// small, by enough keyframes, and successive estimates agree.
void update(MapCamera* camera, const FreeCamera& adjusted, const KeyframeCount& keyframes,
            const SelfCalibrationOptions& options);
/// Whether there were keyframes enough, and still the focal length is not known.
[[nodiscard]] bool cannot_be_known(const MapCamera& camera, const SelfCalibrationOptions& options);

/// How far the camera has moved from the values under which points were searched. Unless by nothing worth
/// aiming patches anew, its present values count as searched with from now on.
enum class CameraMove : uint8_t {
  kNone,
  kSettled,  ///< by little, and it is known now: the last time
  kFelt      ///< by what a search feels
};
CameraMove take_move(MapCamera* camera, const SelfCalibrationOptions& options);

/// What it is now counts as published.
void count_as_published(MapCamera* camera, const SelfCalibrationOptions& options);
/// Makes a new version if the values have changed by what can be seen, if they are known notably better, or
/// were frozen. Whether it has.
bool publish(MapCamera* camera, const SelfCalibrationOptions& options, const PublicationOptions& publication);

}  // namespace cairn
