// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/se3.h"

/// Whether images that are known in two maps agree on how these lie to each other. Each map has a frame and a
/// unit of length of its own, so the transform between them is a similarity. Pure.
namespace cairn {

/// [mean depths plus rad] Poses of one image in one map that are farther apart (separation()) contradict each
/// other. The same pose from two keyframes is off by a third of that, which leaves room for what two maps of
/// a place differ in and for the scale of a short base.
constexpr double kSamePose = 0.15;

struct MapAgreementOptions {
  /// [mean depths plus rad] A view agrees with a similarity that puts its two poses no farther apart
  /// (separation()).
  double same_pose = kSamePose;
  /// [mean depths] Least distance between the centres of two views that define a similarity; views that are
  /// nearer to each other say little of the scale.
  double least_base = 0.1;
};

/// Options of the detection of maps that show the same place (overlap_detector). Where no reason is given, a
/// value is chosen, not measured.
struct OverlapOptions {
  /// Number of maps in which an image is found after which it is looked for in no others; it bounds the work.
  uint64_t most_maps = 4;
  /// Number of the newest shared keyframes of a pair of maps that are kept: how the maps lie to each other is
  /// known from a few.
  uint64_t most_shown = 32;
  /// [mean depths plus rad] A keyframe that stands no farther than this from one of another map
  /// (separation()) should be found there.
  double next_to = 0.3;
  /// Number of keyframes that have to agree on one similarity before maps overlap: one may be a look-alike,
  /// and its neighbours show the same.
  uint64_t least_keyframes = 3;
  MapAgreementOptions agreement;
};

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

/// The similarity with which most views agree, and of equals the one with the least error; nothing if no two
/// views agree on one. O(n^3).
[[nodiscard]] std::optional<MapAgreement> find_agreement(std::span<const SharedView> views,
                                                         const MapAgreementOptions& options);

/// How far apart two cameras in one frame are: the distance over `depth` [map unit], plus the angle [rad].
[[nodiscard]] double separation(const SE3& a, const SE3& b, double depth);

}  // namespace cairn
