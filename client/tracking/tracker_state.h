// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "client/relocalization/recovery.h"
#include "client/tracking/dead_reckoning.h"
#include "client/tracking/evidence.h"
#include "client/tracking/exposure.h"
#include "client/tracking/flow_prior.h"
#include "client/tracking/gyro_prior.h"
#include "client/tracking/keyframe_policy.h"
#include "client/tracking/local_map.h"
#include "client/tracking/map_growth.h"
#include "client/tracking/motion.h"
#include "client/tracking/pose_finder.h"
#include "client/tracking/provisional_points.h"
#include "client/tracking/still_regions.h"
#include "client/tracking/tracker.h"
#include "client/tracking/trail_pose.h"
#include "client/tracking/trails.h"
#include "common/image/frame_images.h"

namespace cairn {

/// The state of a tracker between frames, and the parts of a frame: its beginning and end in tracker.cpp, the
/// search for the camera in tracker_search.cpp. One thread.
struct Tracker::State {
  State(const CameraPtr& camera_in, const TrackerOptions& options_in);

  CameraPtr camera;
  TrackerOptions options;
  Recovery recovery;
  TrailFollower trails;
  PoseFinder finder;
  FlowPrior flow;
  ProvisionalPoints provisional;
  DeadReckoning reckoning;
  int in_sight = 0;  ///< points of the map that the frame should show, from where it is expected
  KeyframePolicy keyframes;
  LocalMap local;
  std::vector<LocalPoint> known;               ///< of the frame, as
  std::vector<LocalMeasurement> measurements;  ///< are these
  std::vector<uint64_t> counted;               ///< points of the local map since the frame before
  uint64_t proposals = 0;
  MotionModel model;
  GyroPrior gyro;
  StillRegions still;

  std::array<FrameImages, 2> frames;
  size_t current = 0;
  bool has_previous = false;
  Timestamp frame_time;
  Exposure exposure;
  TinyMotion seen;      ///< how the tiny image moved since the previous frame
  float likeness = -1;  ///< of the small images, the motion undone
  bool is_cut = false;  ///< it has nothing in common with it

  MapSnapshotPtr map;   ///< the server's, with what the tracker has added
  AnchoredPose latest;  ///< the last pose measured
  double mean_depth = 1;
  double near_depth = 1;  ///< of what is nearest
  FrameResult result;
  StageProbe* probe = nullptr;

  FrameImages& now() { return frames[current]; }
  FrameImages& previous() { return frames[1 - current]; }
  /// Whether another map may be entered while starting: not while one's own is decided about.
  [[nodiscard]] bool may_enter() const { return !trails.is_undecided(); }

  // A frame, in this order.
  void begin_frame(const GrayImagePtr& image, Timestamp time, StageProbe* stage_probe);
  void start(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& snapshot);
  void locate(Timestamp time, const MapSnapshotPtr& snapshot);
  void end_frame(Timestamp time);

  void clear_result();
  void follow_trails(const GrayImagePtr& image, Timestamp time);
  void enter_map(const MapSnapshotPtr& snapshot, Timestamp time);
  void begin_map(const MapSnapshotPtr& snapshot, Timestamp time);
  void adopt_revision(const MapSnapshotPtr& server_map, Timestamp time);

  /// A search of the frame: what was found, and how far it is to be believed.
  struct Attempt {
    std::optional<SE3> pose;
    FrameEvidence evidence;
    PoseVerdict verdict = PoseVerdict::kBad;
  };
  [[nodiscard]] Attempt attempt(const SE3& from, const SearchEffort& effort);
  [[nodiscard]] Attempt judged(Attempt found, PoseOrigin origin) const;
  [[nodiscard]] Attempt search_by_motion(Timestamp time);
  [[nodiscard]] Attempt compared_within_reach(Attempt found);
  [[nodiscard]] Attempt search_otherwise();
  [[nodiscard]] SearchEffort expected_effort() const;
  [[nodiscard]] SearchEffort effort_of(PoseStart::Reach reach) const;
  /// How the camera has turned since the frame before (now from before), by the small images, or by the gyro
  /// where these have nothing in common.
  [[nodiscard]] SE3 turned() const {
    return gyro.turn() && is_cut ? *gyro.turn()
                                 : correct_step(SE3(), seen, *camera, mean_depth, options.step_correction);
  }

  void track(Timestamp time);
  void look_for_camera(Timestamp time);
  [[nodiscard]] bool hold(Timestamp time);
  [[nodiscard]] bool hold_blindly();
  void claim_held(bool is_position_known);
  void measured(const SE3& camera_from_map, Timestamp time);
  void accept(const Attempt& found, Timestamp time);
  void miss(Timestamp time, std::string why);
  void publish(const Attempt& found, Timestamp time);
  void propose_keyframe(Timestamp time);
  void map_locally(Timestamp time, KeyframeProposal* proposal);
  void report_search();
  void learn_still();
};

}  // namespace cairn
