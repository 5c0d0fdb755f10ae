// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/geometry/se3.h"
#include "common/map/label.h"
#include "common/map/snapshot.h"
#include "common/wire/messages.h"

namespace cairn {

/// A text label at a place of the map (map frame), pointed at by a camera. It is said relative to the
/// keyframe nearest to the camera, which sees about what the camera sees. Nothing for a map without
/// keyframes.
[[nodiscard]] std::optional<wire::ClientRequest> request_new_label(const MapSnapshot& map,
                                                                   const SE3& camera_from_map,
                                                                   const Eigen::Vector3d& place,
                                                                   std::string text);
[[nodiscard]] wire::ClientRequest request_label_text(MapId map, LabelId label, std::string text);
[[nodiscard]] wire::ClientRequest request_label_removal(MapId map, LabelId label);

}  // namespace cairn
