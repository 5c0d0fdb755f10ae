// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "common/image/descriptor.h"
#include "common/image/tiny_image.h"
#include "common/map/keyframe_view.h"
#include "server/relocalization/brightness.h"
#include "server/relocalization/vocabulary.h"

/// A keyframe as the relocalizer searches it: an immutable value.
namespace cairn {

/// Blur of the tiny images compared (PTAM r114).
constexpr float kPlaceBlur = 2.5F;

/// Scales at which points are described: each pyramid level and, half an octave coarser, the level reduced by
/// the square root of two. A descriptor stands a change of scale by 1.2 or so; levels alone leave gaps.
constexpr int kPlaceScales = 2 * kPyramidLevels;

/// Factor on the exposure of a keyframe with which its points are described a second time. By trials, on
/// queries of gain 2 (tests/bench/HISTORY.md).
constexpr int kOverexposure = 2;

/// Which map point a descriptor is of.
struct DescribedPoint {
  uint32_t measured = 0;  ///< index into IndexedKeyframe::measured
  /// Scale of the description: twice the level at which the point was measured, or one more.
  uint8_t scale = 0;
};

/// How a keyframe saw a point.
struct Sighting {
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0
  std::optional<Brightness> brightness;             ///< there
  uint8_t level = 0;                                ///< at which it was measured
  uint8_t descriptions = 0;                         ///< number of its descriptions: none near the border
};

/// The points of a keyframe as they look at one exposure.
struct DescribedPoints {
  float white = 0;  ///< share of the image that is clipped
  /// Points in the order of the descriptor's cell, then scale, then `measured`. Each point is there at two
  /// scales, or fewer near the border.
  std::vector<DescribedPoint> points;
  std::vector<Descriptor> descriptors;  ///< of `points`
  /// Points of cell c at scale s are [begin_of[c * kPlaceScales + s], the next one).
  std::array<uint32_t, kVocabularyCells * kPlaceScales + 1> begin_of{};
  /// For each of IndexedKeyframe::measured, indices into `points`: as many as Sighting::descriptions.
  std::vector<std::array<uint32_t, 2>> of_measured;
};

struct IndexedKeyframe {
  KeyframeId id;
  CameraPtr camera;
  TinyImage tiny;                   ///< blur kPlaceBlur, zero mean
  float contrast = 0;               ///< root mean square of `tiny` [grey levels]
  std::vector<PointId> measured;    ///< ascending: what the keyframe measured when it was indexed
  std::vector<Sighting> sightings;  ///< of `measured`
  DescribedPoints as_taken;
  /// The points as they look at kOverexposure; nothing if less than a hundredth (chosen, not measured) more
  /// of the image would be white. In white nothing is left of a corner and what is next to it looks
  /// otherwise, which no descriptor of the image as it was taken foretells.
  std::optional<DescribedPoints> overexposed;
  std::vector<WordId> words;  ///< of the descriptors of `as_taken`, ascending, each once

  /// Returns the points as they look in an image of which the share `white` is clipped: those of the exposure
  /// with the nearer share.
  [[nodiscard]] const DescribedPoints& exposed_as(float white) const;
};
using IndexedKeyframePtr = std::shared_ptr<const IndexedKeyframe>;

/// Indexes a keyframe. Points that `previous` (null: none), the keyframe as it was indexed before, measured
/// at the same pixel and level are taken from there, unless its image was another; the others are described.
/// A few milliseconds without `previous`.
[[nodiscard]] IndexedKeyframePtr index_keyframe(const KeyframeView& view,
                                                const IndexedKeyframe* previous = nullptr);

}  // namespace cairn
