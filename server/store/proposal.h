// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/geometry/up_direction.h"
#include "common/map/ids.h"
#include "common/map/observations.h"

namespace cairn {

/// A keyframe that was kept aside as a proposal, as operators are told of it: without what it takes to make
/// it a keyframe of the map.
struct ProposalSummary {
  uint64_t number = 0;  ///< in its map, from 1; later ones are higher, and none comes again
  std::string client;   ///< name of who proposed it
  SessionId session;    ///< of the offer that it was
  uint64_t seq = 0;
  std::string why;     ///< it is no keyframe: the reason that would have been a refusal's
  Timestamp received;  ///< of the wall clock
  Timestamp time;      ///< of the frame, by the client's clock
  Epoch epoch;         ///< of the map, when it was made
  /// Pose in the map as it was then.
  SE3 camera_from_map;
  double mean_depth = 0;  ///< [map unit] of the points found in it
  uint32_t expected = 0;  ///< points of the map that should be seen in it
  uint32_t found = 0;     ///< number of `expected` that were found
  uint64_t bytes = 0;     ///< rough size that it takes in the store
};

/// A keyframe kept aside: all that came with the offer, so that the map maker can judge it later.
struct ProposalRecord {
  ProposalSummary summary;
  KeyframeId reference;
  SE3 camera_from_reference;
  CameraParameters camera;  ///< whose values are exact
  std::vector<PointMeasurement> measurements;
  std::vector<PointCandidate> candidates;
  std::vector<uint8_t> still_mask;  ///< bits_of(StillMask)
  std::optional<UpDirection> up;
};

/// A proposal with its image.
struct KeptProposal {
  ProposalRecord record;
  std::vector<uint8_t> image;  ///< PNG, grey
};

}  // namespace cairn
