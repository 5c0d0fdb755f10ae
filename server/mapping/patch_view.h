// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "server/mapping/map_state.h"

/// Projects a point's patch into a keyframe, and finds it there. All functions are pure and may run on any
/// thread.
namespace cairn {

/// Limit of the ZMSSD at a whole pixel (PTAM r114). Half a pixel off, a sharp corner differs from itself by
/// this much; the stricter kMaxZmssd applies after refinement. No option, as that one is none: both say when
/// two patches are the same, for tracker and map maker alike.
constexpr int kSearchZmssd = 64 * 500;

/// A patch as projected into an image.
struct PatchView {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< level-0 px, of the patch's reference pixel
  Warp warp = Warp::Identity();                     ///< level-0 px of this image per source-level px
  int level = 0;                                    ///< at which to search
};

/// The source of a point whose patch is cut around a corner of a keyframe, its surface facing the camera.
/// Nothing when the patch leaves the image.
[[nodiscard]] std::optional<PointSource> make_source(const MapKeyframe& keyframe, int level, Corner corner);

/// Sets the rays and normal of a source for its keyframe's present camera.
void aim_source(const Camera& camera, PointSource* source);

/// Projects a patch. `point` in the source camera's frame, target_from_source between cameras. Nothing when
/// it does not project into the image, is edge-on, or is too large, too small or turned away (warp_level).
[[nodiscard]] std::optional<PatchView> view_patch(const PointSource& source, const Eigen::Vector3d& point,
                                                  const SE3& target_from_source, const Camera& target);

/// A patch found in an image.
struct PatchFound {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px, sub-pixel
  uint8_t level = 0;
};

/// Searches the corners within `radius` px (of the search level) of where the patch projects, then refines to
/// sub-pixel.
[[nodiscard]] std::optional<PatchFound> find_near_corner(const PointSource& source, const PatchView& view,
                                                         const KeyframeImages& images, float radius);
/// Refines from a given level-0 pixel, without corners; `max_shift` in px of the search level.
[[nodiscard]] std::optional<PatchFound> refine_from(const PointSource& source, const PatchView& view,
                                                    const KeyframeImages& images,
                                                    const Eigen::Vector2f& start, float max_shift);

/// view_patch() of a map point in a keyframe of the map.
[[nodiscard]] std::optional<PatchView> view_point(const MapState& map, const MapPoint& point,
                                                  const MapKeyframe& keyframe);

}  // namespace cairn
