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
  /// The camera after the last adjustment: what the map's keyframes have.
  CameraPtr camera;
  Intrinsics sigma = Intrinsics::Zero();
  Intrinsics prior_mean = Intrinsics::Zero();
  Intrinsics prior_sigma = Intrinsics::Zero();
  bool frozen = false;  ///< known well enough: no longer adjusted

  Intrinsics judged = Intrinsics::Zero();  ///< the first of the successive estimates that agree
  size_t judged_keyframes = 0;             ///< keyframes ever made when the camera was last judged
  /// Number of successive estimates, of more and more keyframes, that agree with `judged`.
  int agreements = 0;
  /// Values under which points were searched that are given up, and rays of patches aimed.
  Intrinsics searched = Intrinsics::Zero();

  CameraPtr published;
  Intrinsics published_sigma = Intrinsics::Zero();
  bool published_frozen = false;
  bool published_unknown = false;  ///< that the focal length cannot be known
};

/// Number of keyframes of a camera.
struct KeyframeCount {
  size_t live = 0;
  size_t made = 0;  ///< ever, removed ones included
};

[[nodiscard]] MapCamera make_map_camera(const CameraPtr& camera, const CameraPrior& prior);

/// Whether there are enough new keyframes to look for other focal lengths and to say how well it is known:
/// both take several adjustments. At first any keyframe is enough, but for a camera whose focal length was
/// believed: that is judged when it may soon be frozen. Once many keyframes have not told it, it takes a
/// quarter more of them.
[[nodiscard]] bool is_worth_judging(const MapCamera& camera, const KeyframeCount& keyframes,
                                    const SelfCalibrationOptions& options);
/// Takes in the values and sigmas that an adjustment of these keyframes found. If it has judged the camera,
/// and there are new keyframes, freezes one that is known well enough: sigma small, by enough keyframes, and
/// successive estimates agree.
void update(MapCamera* camera, const FreeCamera& adjusted, const KeyframeCount& keyframes,
            const SelfCalibrationOptions& options);
/// Whether there were enough keyframes (SelfCalibrationOptions::many_keyframes), and still the focal length
/// is not known.
[[nodiscard]] bool cannot_be_known(const MapCamera& camera, const SelfCalibrationOptions& options);

/// How far the camera has moved from the values under which points were searched.
enum class CameraMove : uint8_t {
  kNone,
  kSettled,  ///< by little, but it has become known: the last time
  kFelt      ///< by so much that searches are affected (SelfCalibrationOptions::felt_move)
};
/// Returns how far the camera has moved. Unless that is kNone, its present values count as searched with from
/// now on.
CameraMove take_move(MapCamera* camera, const SelfCalibrationOptions& options);

/// Counts the camera's present state as published.
void count_as_published(MapCamera* camera, const SelfCalibrationOptions& options);
/// Publishes a new version if the values have changed by what can be seen, if they are known notably better,
/// if they were frozen, or if cannot_be_known() has changed. Returns whether it has.
bool publish(MapCamera* camera, const SelfCalibrationOptions& options, const PublicationOptions& publication);

}  // namespace cairn
