// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/patch_flow.h"

#include <Eigen/Geometry>
#include <cmath>

#include "common/image/patch.h"

namespace cairn {
namespace {

/// A step from one image to another of the same level; pixels are of level 0. `corners`: of the other image,
/// looked at where the alignment does not get there; null: it must.
std::optional<Eigen::Vector2f> step_to(const GrayView& from_image, const GrayView& to_image, int level,
                                       const Eigen::Vector2f& from, const Eigen::Vector2f& start,
                                       const CornerList* corners, const PatchFlowOptions& options) {
  const Eigen::Vector2f at(to_level(from.x(), level), to_level(from.y(), level));
  const Corner corner{static_cast<int16_t>(std::lround(at.x())), static_cast<int16_t>(std::lround(at.y()))};
  SourcePatch cut;
  PatchTemplate patch;
  if (!cut_source_patch(from_image, corner, &cut) || !make_template(cut, Warp::Identity(), 0, &patch))
    return std::nullopt;
  const Eigen::Vector2f aside = Eigen::Vector2f(corner.x, corner.y) - at;
  const Eigen::Vector2f expected(to_level(start.x(), level), to_level(start.y(), level));
  auto there = refine_patch(patch, to_image, expected + aside, options.iterations);
  if (!there && corners != nullptr) {
    const auto match = find_patch(patch, to_image, *corners, expected,
                                  options.search_radius / static_cast<float>(1 << level));
    if (match)
      there = refine_patch(patch, to_image, Eigen::Vector2f(match->corner.x, match->corner.y),
                           options.iterations);
  }
  if (!there) return std::nullopt;
  const Eigen::Vector2f found = *there - aside;
  return Eigen::Vector2f(from_level(found.x(), level), from_level(found.y(), level));
}

}  // namespace

std::optional<Eigen::Vector2f> follow_patch(const FrameImages& previous, const FrameImages& now,
                                            const Eigen::Vector2f& from, const Eigen::Vector2f& expected,
                                            const PatchFlowOptions& options) {
  Eigen::Vector2f start = expected;
  bool found = false;
  for (int level = options.coarsest_level; level >= 0; --level) {
    const GrayView before = previous.pyramid.level(level);
    const GrayView image = now.pyramid.level(level);
    const CornerList* corners = level <= options.required_level ? &now.corners(level) : nullptr;
    const auto there = step_to(before, image, level, from, start, corners, options);
    if (!there) continue;
    if (level <= options.required_level) {
      const auto home = step_to(image, before, level, *there, from, nullptr, options);
      if (!home || (*home - from).norm() > options.way_back_error * static_cast<float>(1 << level)) continue;
      found = true;
    }
    start = *there;
  }
  if (!found) return std::nullopt;
  return start;
}

Eigen::Vector2f moved_by(const TinyMotion& motion, const Eigen::Vector2f& pixel, const GrayImage& image) {
  constexpr auto kScale = static_cast<float>(1 << kPyramidLevels);  // the small image is level 3 halved again
  const Eigen::Vector2f center((static_cast<float>(image.width()) - 1) / 2,
                               (static_cast<float>(image.height()) - 1) / 2);
  return center + Eigen::Rotation2Df(motion.angle) * (pixel - center) + kScale * motion.shift;
}

}  // namespace cairn
