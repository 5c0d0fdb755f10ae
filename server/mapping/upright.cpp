// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/upright.h"

namespace cairn {

void stand_upright(KeyframeId knows_up, MapState* map) {
  const MapKeyframe& k = map->keyframe(knows_up);
  if (!k.up) return;
  const UpDirection up = turned(k.camera_from_map.rotation().conjugate(), *k.up);
  const auto upright_from_map = Eigen::Quaterniond::FromTwoVectors(up.up, Eigen::Vector3d::UnitZ());
  map->transform({1, upright_from_map, Eigen::Vector3d::Zero()});
}

}  // namespace cairn
