// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "common/map/ids.h"

namespace cairn {

/// A trail from the first image of a two-view start to the second, level-0 px (distorted, as seen).
struct Trail {
  TrailId id;
  Eigen::Vector2f first = Eigen::Vector2f::Zero();
  Eigen::Vector2f second = Eigen::Vector2f::Zero();
};

/// The state that a tracker tells with every frame. The wire carries its number, so it grows only at the end.
enum class TrackingState : uint8_t {
  kStarting = 0,  ///< no map yet: following trails
  kTracking = 1,
  kPoor = 2,  ///< tracked, but few of the points in sight are found
  kLost = 3,
  kRotation = 4,  ///< the camera has turned away from what its map shows; where it was then is its position
  kLast = kRotation,
};

/// A map point found in a frame.
struct PointMeasurement {
  PointId id;
  uint8_t level = 0;  ///< pyramid level at which it was found; sigma = 2^level px
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px (distorted, as seen)
};

/// A corner that the map has no point of, followed by a tracker with known poses until its depth was known.
struct PointCandidate {
  CandidateId id;  ///< stays the same from frame to frame
  uint8_t level = 0;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px (distorted, as seen)
  float inverse_depth = 0;                          ///< along the unit ray of the pixel [1 / map unit]
  float sigma = 0;                                  ///< of the inverse depth
};

}  // namespace cairn
