// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/map_camera.h"

namespace cairn {
namespace {

constexpr double kVisibleMove = 0.2;    ///< [px] DESIGN 4
constexpr double kNotablyBetter = 0.7;  ///< of the sigma published before
const Intrinsics kWellKnown(0.003, 0.01);

}  // namespace

MapCamera make_map_camera(const CameraPtr& camera, const CameraDoubt& doubt) {
  MapCamera result;
  result.version = doubt.version;
  result.camera = result.published = camera;
  result.sigma = result.published_sigma = result.prior_sigma = doubt.sigma;
  result.prior_mean = intrinsics_of(*camera);
  return result;
}

void update(MapCamera* camera, const FreeCamera& adjusted) {
  camera->camera = adjusted.camera;
  camera->sigma = adjusted.covariance.diagonal().cwiseSqrt();
  camera->frozen = (camera->sigma.array() <= kWellKnown.array()).all();
}

Publication publish(MapCamera* camera) {
  const bool moved = camera->frozen != camera->published_frozen ||
                     largest_move(*camera->published, *camera->camera) > kVisibleMove;
  const bool better = (camera->sigma.array() < kNotablyBetter * camera->published_sigma.array()).any();
  if (!moved && !better) return Publication::kNone;
  ++camera->version.version;
  // What cannot be seen is left out, so that a version known better needs no new patches.
  if (moved) camera->published = camera->camera;
  camera->published_sigma = camera->sigma;
  camera->published_frozen = camera->frozen;
  return moved ? Publication::kMoved : Publication::kKnownBetter;
}

}  // namespace cairn
