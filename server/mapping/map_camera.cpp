// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_camera.h"

#include <algorithm>
#include <cmath>

#include "common/geometry/camera_guess.h"

namespace cairn {
namespace {

/// Whether the camera's prior sigma was small.
bool was_believed(const MapCamera& camera, const SelfCalibrationOptions& options) {
  return camera.prior_sigma[0] <= options.known_focal_sigma;
}

size_t fewest_keyframes(const MapCamera& camera, const SelfCalibrationOptions& options) {
  return was_believed(camera, options) ? options.fewest_of_believed : options.fewest_keyframes;
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

bool is_worth_judging(const MapCamera& camera, const KeyframeCount& keyframes,
                      const SelfCalibrationOptions& options) {
  const size_t before = camera.judged_keyframes;
  // The focal length of one that was believed is in no wrong valley; it is judged when it may be frozen.
  const auto looks = static_cast<size_t>(options.enough_agreements);
  if (was_believed(camera, options) && keyframes.live + looks < options.fewest_of_believed &&
      keyframes.made < options.many_keyframes)
    return false;
  return !camera.frozen &&
         keyframes.made > before + (cannot_be_known(camera, options) ? before / options.one_more_to : 0);
}

void update(MapCamera* camera, const FreeCamera& adjusted, const KeyframeCount& keyframes,
            const SelfCalibrationOptions& options) {
  camera->camera = adjusted.camera;
  // What was held closer than the prior would, or could not be judged, is known no better than before.
  for (int i = 0; i < kIntrinsics; ++i) {
    const double found = std::sqrt(adjusted.covariance(i, i));
    const bool is_known = adjusted.prior_sigma[i] >= camera->prior_sigma[i] && found < camera->prior_sigma[i];
    camera->sigma[i] = is_known ? std::max(found, kLeastPriorSigma) : camera->prior_sigma[i];
  }
  if (!adjusted.judge || keyframes.made <= camera->judged_keyframes) return;
  const Intrinsics values = intrinsics_of(*camera->camera);
  const bool agrees = std::abs(values[0] - camera->judged[0]) <= options.agreement;
  camera->agreements = agrees ? camera->agreements + 1 : 0;
  if (!agrees) camera->judged = values;
  camera->judged_keyframes = keyframes.made;
  camera->frozen = keyframes.live >= fewest_keyframes(*camera, options) && !is_held_by_prior(adjusted) &&
                   camera->agreements >= options.enough_agreements &&
                   camera->sigma[0] <= options.known_focal_sigma &&
                   camera->sigma[1] <= options.known_k1_sigma;
}

bool cannot_be_known(const MapCamera& camera, const SelfCalibrationOptions& options) {
  return !camera.frozen && camera.judged_keyframes >= options.many_keyframes;
}

CameraMove take_move(MapCamera* camera, const SelfCalibrationOptions& options) {
  const Intrinsics values = intrinsics_of(*camera->camera);
  const bool felt = std::abs(values[0] - camera->searched[0]) > options.felt_move;
  if (!felt && (!camera->frozen || values == camera->searched)) return CameraMove::kNone;
  camera->searched = values;
  return felt ? CameraMove::kFelt : CameraMove::kSettled;
}

void count_as_published(MapCamera* camera, const SelfCalibrationOptions& options) {
  camera->published = camera->camera;
  camera->published_sigma = camera->sigma;
  camera->published_frozen = camera->frozen;
  camera->published_unknown = cannot_be_known(*camera, options);
}

bool publish(MapCamera* camera, const SelfCalibrationOptions& options,
             const PublicationOptions& publication) {
  const bool moved = camera->frozen != camera->published_frozen ||
                     largest_move(*camera->published, *camera->camera) > publication.visible_move;
  const bool better =
      (camera->sigma.array() < publication.better_sigma * camera->published_sigma.array()).any() ||
      cannot_be_known(*camera, options) != camera->published_unknown;
  if (!moved && !better) return false;
  ++camera->version.version;
  count_as_published(camera, options);
  return true;
}

}  // namespace cairn
