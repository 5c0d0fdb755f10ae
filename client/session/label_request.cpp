// SPDX-License-Identifier: Apache-2.0
#include "client/session/label_request.h"

#include <utility>

namespace cairn {

std::optional<wire::ClientRequest> request_new_label(const MapSnapshot& map, const SE3& camera_from_map,
                                                     const Eigen::Vector3d& place, std::string text) {
  const KeyframePose* reference = map.nearest_keyframe(camera_from_map.center());
  if (reference == nullptr) return std::nullopt;
  const SE3 map_from_label(camera_from_map.rotation().conjugate(), place);
  wire::ClientRequest request;
  request.action = wire::RequestAction::kAddLabel;
  request.map = map.map;
  request.text = std::move(text);
  request.epoch = map.epoch;
  request.reference = reference->id;
  request.reference_from_label = reference->camera_from_map * map_from_label;
  return request;
}

wire::ClientRequest request_label_text(MapId map, LabelId label, std::string text) {
  wire::ClientRequest request;
  request.action = wire::RequestAction::kRenameLabel;
  request.map = map;
  request.label = label;
  request.text = std::move(text);
  return request;
}

wire::ClientRequest request_label_removal(MapId map, LabelId label) {
  wire::ClientRequest request;
  request.action = wire::RequestAction::kRemoveLabel;
  request.map = map;
  request.label = label;
  return request;
}

}  // namespace cairn
