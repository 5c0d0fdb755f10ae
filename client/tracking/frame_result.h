// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/geometry/se3.h"
#include "common/geometry/up_direction.h"
#include "common/image/image.h"
#include "common/image/place.h"
#include "common/image/still_mask.h"
#include "common/map/ids.h"
#include "common/map/observations.h"

/// What a tracker says about a frame, what it proposes to the server, and what that answers.
namespace cairn {

/// Two frames and the trails between them that look like a map: to be sent as MapSeed.
struct SeedProposal {
  Timestamp first_time;
  Timestamp second_time;
  GrayImagePtr first_image;
  GrayImagePtr second_image;
  std::vector<Trail> trails;
  SE3 second_from_first;                      ///< |translation| = 1
  StillMaskPtr still = {};                    ///< what stands still in both images; null: nothing
  std::optional<UpDirection> second_up = {};  ///< in the axes of the second view; nothing: not known
};

/// The present frame as a keyframe: to be sent as KeyframeOffer together with its image.
struct KeyframeProposal {
  MapId map;
  Epoch epoch;
  Revision revision;
  KeyframeId reference;  ///< none: the proposal `reference_number`
  SE3 camera_from_reference;
  std::vector<PointMeasurement> measurements;
  std::vector<PointCandidate> candidates;
  uint64_t number = 0;  ///< of the tracker's proposals, from 1: the answer names it
  /// The proposal that it was tracked against, which has not been answered; 0: none, `reference` was.
  uint64_t reference_number = 0;
  StillMaskPtr still = {};             ///< what stands still in its image; null: nothing
  std::optional<UpDirection> up = {};  ///< in the camera's axes; nothing: not known
};

/// The server's yes to a seed.
struct SeedAnswer {
  MapId map;
  Epoch epoch;
  Revision revision;
  KeyframeId second_keyframe;
  std::vector<std::pair<TrailId, PointId>> points;
};

/// A map point for the overlay: the place where it was found, or else expected.
struct TrackedPoint {
  PointId id;
  uint8_t level = 0;
  bool found = false;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level 0; where found, else where expected
};
struct TrailLine {
  Eigen::Vector2f first = Eigen::Vector2f::Zero();
  Eigen::Vector2f now = Eigen::Vector2f::Zero();
};

/// The state of the camera's IMU in a frame: whether it tells how the camera turned since the frame before.
enum class ImuUse : uint8_t {
  kNone,         ///< there is none
  kUsed,         ///< it tells how the camera turned
  kMissing,      ///< it tells nothing: its samples leave a gap there
  kContradicts,  ///< it is not used: its gyro turns otherwise than the images do
};

struct FrameResult {
  TrackingState state = TrackingState::kStarting;
  bool pose_measured = false;  ///< the pose comes from points measured in this frame
  /// The pose was measured, but found by looking for it, and has still to hold in the next frames. It is for
  /// statistics, not to be shown.
  bool verifying = false;
  SE3 camera_from_map;
  MapId map;
  Epoch epoch;
  Revision revision;
  int attempted = 0;
  int found = 0;                ///< inliers of the final pose
  float quality = 0;            ///< share found of the points that should be visible and that no others hide
  double mean_depth = 0;        ///< [map unit] of the found points
  double reprojection_rms = 0;  ///< [px of level 0, scaled by 2^-level] of the inliers
  std::vector<TrackedPoint> points;  ///< memory is reused from frame to frame
  std::vector<TrailLine> trails;
  std::optional<SeedProposal> seed;
  std::optional<KeyframeProposal> keyframe;
  /// The frame as the server's relocalizer wants it described, if a query about it is to be made
  /// (Recovery::ask); else null.
  std::shared_ptr<const PlaceView> reloc_query;
  ImuUse imu = ImuUse::kNone;
  std::string note;  ///< for the status line: why there is no map yet, why it is lost
};

}  // namespace cairn
