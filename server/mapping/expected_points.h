// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "server/mapping/map_maker_options.h"
#include "server/mapping/map_state.h"

/// The points of a published map that an image shows, for code that has no map maker at hand, or must not
/// wait for it. Pure, on any thread.
namespace cairn {

/// A point of the map that should be seen in an image.
struct ExpectedPoint {
  PointId id;
  bool found = false;
  /// Level-0 px: where it was found, else where it should be.
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  double depth = 0;  ///< along the optical axis [map unit]
};

/// The live points of `map` that project into the image at a scale and from a side at which their patches
/// look alike, and whether they are there. They are looked for as the map maker does for known points;
/// `options` are its own. `most`: if there are more, a selection that is spread over them all, the same on
/// every call. Points that project onto what stands still in the image are left out.
[[nodiscard]] std::vector<ExpectedPoint> expected_points(const MapSnapshot& map, const Camera& camera,
                                                         const SE3& camera_from_map,
                                                         const KeyframeImages& images,
                                                         const StillMaskPtr& still, size_t most,
                                                         const RefindOptions& options);

}  // namespace cairn
