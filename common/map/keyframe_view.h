// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/up_direction.h"
#include "common/image/corners.h"
#include "common/image/pyramid.h"
#include "common/map/ids.h"
#include "common/map/observations.h"

namespace cairn {

/// A keyframe with its image and what was measured in it, as handed from the map maker to who reads maps.
/// Immutable parts are shared; cheap to copy but for the measurements.
struct KeyframeView {
  KeyframeId id;
  CameraPtr camera;
  std::shared_ptr<const Pyramid> pyramid;      ///< null: evicted
  std::vector<PointMeasurement> measurements;  ///< ascending by point
  /// FAST-10 corners of `pyramid` by level, as a query about the image wants them
  /// (common/image/place.h); null where nobody has looked for them.
  std::shared_ptr<const std::array<CornerList, kPyramidLevels>> corners = {};
  std::optional<UpDirection> up = {};  ///< in the camera's axes; nothing: not known
};

}  // namespace cairn
