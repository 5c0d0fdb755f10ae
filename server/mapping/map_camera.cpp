// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_camera.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/camera_guess.h"
#include "server/mapping/snapshot_builder.h"

namespace cairn {
namespace {

constexpr double kNotablyBetter = 0.7;     ///< of the sigma published before
const Intrinsics kWellKnown(0.0125, 0.1);  ///< sigma: focal length within 2.5 % with 95 %
/// Of successive focal lengths, with the first of them: a slow drift is none. What was measured under a
/// camera that is off agrees with it, and it takes many keyframes to draw the estimate away.
constexpr double kAgreement = 0.01;
constexpr int kEnoughAgreements = 3;
constexpr size_t kFewestKeyframes = 12;  ///< whose spread says something
constexpr size_t kFewestOfBelieved =
    20;                                ///< where the sigma was small to begin with and tells nothing of them
constexpr size_t kManyKeyframes = 40;  ///< what these have not told, more of the same will not
constexpr size_t kManyMore = 4;        ///< one to so many of these: worth another look
constexpr double kFeltMove = 0.02;     ///< of the focal length: some px where the image ends

/// Whether its sigma was small to begin with.
bool was_believed(const MapCamera& camera) {
  return camera.prior_sigma[0] <= kWellKnown[0];
}

size_t fewest_keyframes(const MapCamera& camera) {
  return was_believed(camera) ? kFewestOfBelieved : kFewestKeyframes;
}

}  // namespace

MapCamera make_map_camera(const CameraPtr& camera, const CameraPrior& prior) {
  MapCamera result;
  result.version = prior.version;
  result.version.version = 1;
  result.camera = result.published = camera;
  result.sigma = result.published_sigma = result.prior_sigma = prior.sigma;
  result.prior_mean = result.searched = intrinsics_of(*camera);
  return result;
}

bool is_worth_judging(const MapCamera& camera, const KeyframeCount& keyframes) {
  const size_t before = camera.judged_keyframes;
  // The focal length of one that was believed is in no wrong valley; it is judged when it may be frozen.
  if (was_believed(camera) && keyframes.live + kEnoughAgreements < kFewestOfBelieved &&
      keyframes.made < kManyKeyframes)
    return false;
  return !camera.frozen && keyframes.made > before + (cannot_be_known(camera) ? before / kManyMore : 0);
}

void update(MapCamera* camera, const FreeCamera& adjusted, const KeyframeCount& keyframes) {
  camera->camera = adjusted.camera;
  // What was held closer than the prior would, or could not be judged, is known no better than before.
  for (int i = 0; i < kIntrinsics; ++i) {
    const double found = std::sqrt(adjusted.covariance(i, i));
    const bool is_known = adjusted.prior_sigma[i] >= camera->prior_sigma[i] && found < camera->prior_sigma[i];
    camera->sigma[i] = is_known ? std::max(found, kLeastPriorSigma) : camera->prior_sigma[i];
  }
  if (!adjusted.judge || keyframes.made <= camera->judged_keyframes) return;
  const Intrinsics values = intrinsics_of(*camera->camera);
  const bool agrees = std::abs(values[0] - camera->judged[0]) <= kAgreement;
  camera->agreements = agrees ? camera->agreements + 1 : 0;
  if (!agrees) camera->judged = values;
  camera->judged_keyframes = keyframes.made;
  camera->frozen = keyframes.live >= fewest_keyframes(*camera) && !is_held_by_prior(adjusted) &&
                   camera->agreements >= kEnoughAgreements &&
                   (camera->sigma.array() <= kWellKnown.array()).all();
}

bool cannot_be_known(const MapCamera& camera) {
  return !camera.frozen && camera.judged_keyframes >= kManyKeyframes;
}

CameraMove take_move(MapCamera* camera) {
  const Intrinsics values = intrinsics_of(*camera->camera);
  const bool felt = std::abs(values[0] - camera->searched[0]) > kFeltMove;
  if (!felt && (!camera->frozen || values == camera->searched)) return CameraMove::kNone;
  camera->searched = values;
  return felt ? CameraMove::kFelt : CameraMove::kSettled;
}

void count_as_published(MapCamera* camera) {
  camera->published = camera->camera;
  camera->published_sigma = camera->sigma;
  camera->published_frozen = camera->frozen;
  camera->published_unknown = cannot_be_known(*camera);
}

bool publish(MapCamera* camera) {
  const bool moved = camera->frozen != camera->published_frozen ||
                     largest_move(*camera->published, *camera->camera) > kVisibleMove;
  const bool better = (camera->sigma.array() < kNotablyBetter * camera->published_sigma.array()).any() ||
                      cannot_be_known(*camera) != camera->published_unknown;
  if (!moved && !better) return false;
  ++camera->version.version;
  count_as_published(camera);
  return true;
}

}  // namespace cairn
