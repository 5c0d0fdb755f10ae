// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/relocalization/pose_suggestion.h"
#include "client/tracking/stage.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/image/place.h"
#include "common/map/ids.h"
#include "common/map/observations.h"
#include "common/map/snapshot.h"

/// The tracker (PTAM 2007, section 5): (frame, map snapshot) -> pose + quality. Pure: no DDS, no threads, no
/// clock; equal inputs give equal bytes. Used from one thread.
namespace cairn {

struct TrackerOptions {
  int max_points = 1100;  ///< patches searched per frame; PTAM r114 has 1000, of which sim-desk shows 490
  int coarse_points = 60;
  float coarse_radius = 30;  ///< [px of level 0]
  float fine_radius = 10;    ///< [px of level 0] without a coarse stage before
  float fine_radius_after_coarse = 5;
  float good_quality = 0.3F;   ///< share found of those in sight; below, a frame is poor
  float lost_quality = 0.13F;  ///< of points on the top two levels; below: a bad frame
  int lost_after_bad_frames = 3;
  int frames_between_keyframes = 20;
  double keyframe_distance =
      0.1;  ///< to the nearest keyframe, over the mean depth (PTAM: 0.1 m over the first depth)
  float running_out =
      0.7F;  ///< of the points found at best since the last keyframe: below, one is needed soon
  int scarce_points = 120;     ///< found: fewer are soon too few to build upon, whatever was found before
  double need_distance = 0.3;  ///< of keyframe_distance, which is enough then
  int trail_count = 1000;      ///< trails begun in the first frame
  bool make_maps = true;       ///< seeds are proposed while there is no map
  bool make_keyframes = true;  ///< keyframes are proposed
  uint64_t seed = 1;
};

/// Two frames and the trails between them that look like a map: to be sent as MapSeed.
struct SeedProposal {
  Timestamp first_time;
  Timestamp second_time;
  GrayImagePtr first_image;
  GrayImagePtr second_image;
  std::vector<Trail> trails;
  SE3 second_from_first;  ///< |translation| = 1
};

/// The present frame as a keyframe: to be sent as KeyframeOffer together with its image.
struct KeyframeProposal {
  MapId map;
  Epoch epoch;
  Revision revision;
  KeyframeId reference;
  SE3 camera_from_reference;
  std::vector<PointMeasurement> measurements;
};

/// The server's yes to a seed.
struct SeedAnswer {
  MapId map;
  Epoch epoch;
  Revision revision;
  KeyframeId second_keyframe;
  std::vector<std::pair<TrailId, PointId>> points;
};

/// For the overlay: where a point was expected or a trail is, and whether it was found.
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

struct FrameResult {
  TrackingState state = TrackingState::kStarting;
  bool pose_measured = false;  ///< the pose comes from points measured in this frame
  /// It was measured, but found by looking for it, and has still to hold in the next frames: for statistics,
  /// not to be shown.
  bool on_trial = false;
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
  /// Lost or starting: the frame as the server's relocalizer wants it described. Null when a question is
  /// under way.
  std::shared_ptr<const PlaceView> place_question;
  std::string note;  ///< for the status line: why there is no map yet, why it is lost
};

/// What a tracker that starts over does where a place is known.
enum class NewMap : uint8_t { kWhereNotKnown, kInAnyCase };

class Tracker {
 public:
  Tracker(const CameraPtr& camera, const TrackerOptions& options);
  ~Tracker();
  Tracker(const Tracker&) = delete;
  Tracker& operator=(const Tracker&) = delete;

  /// Tracks one frame of the camera's size against `map` (null: none yet, trails are followed). A map that no
  /// seed of ours is the beginning of is entered as one who is lost in it. `image` is kept as long as a seed
  /// may need it. The result is valid until the next call.
  const FrameResult& track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                           StageProbe* probe = nullptr);

  /// Other values of the same camera, from the next frame on: together with the revision that was made with
  /// them.
  void use_camera(const CameraPtr& camera);

  /// The seed proposed last was accepted: when a snapshot of that map comes, the pose starts from the trails,
  /// which are followed meanwhile.
  void seed_accepted(const SeedAnswer& answer);
  /// It was refused: trails go on; another proposal comes when the view has changed enough.
  void seed_refused(const std::string& reason);
  /// The answer to `place_question`: where the camera may be, or that no place is known, without a fresh word
  /// of which no seed is proposed. A place that is tried has its poses published when three frames in a row
  /// have proven it; one that was tried in vain again and again counts as not known for a while.
  PlaceUse place_answered(const std::optional<PoseSuggestion>& suggestion);
  /// The question was answered, and not whether the place is known: another may be asked.
  void place_left_open();
  /// Forgets the map in use; the next frames start a new one, or find back into one that is known.
  void start_over(NewMap wish);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace cairn
