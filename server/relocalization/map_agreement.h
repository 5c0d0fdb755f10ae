// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/se3.h"

/// Whether images that are known in two maps say the same of how these lie to each other. Maps have each a
/// frame and a unit of length of their own, so that is a similarity. Pure.
namespace cairn {

/// An image and where it was taken, in the frames of two maps.
struct SharedView {
  SE3 camera_from_one;
  SE3 camera_from_other;
  double depth_in_one = 1;    ///< mean depth of what is seen there [unit of that map]
  double depth_in_other = 1;  ///< [unit of the other]
};

struct MapAgreement {
  Similarity3 other_from_one;
  std::vector<size_t> views;  ///< those that agree with it, ascending: at least two, not taken from one place
};

/// The similarity with which most views agree; nothing: no two of them do. O(n^3); of equals that with the
/// least error.
[[nodiscard]] std::optional<MapAgreement> find_agreement(std::span<const SharedView> views);

/// Poses of one image in one map that are farther apart contradict each other; the same pose from two
/// keyframes is off by a third of that, which leaves room for what two maps of a place differ in and for the
/// scale of a short base. An angle alone counts as much [rad].
constexpr double kSamePose = 0.15;

/// How far apart two cameras in one frame are: distance in mean depths, plus angle in radians.
[[nodiscard]] double separation(const SE3& a, const SE3& b, double depth);

}  // namespace cairn
