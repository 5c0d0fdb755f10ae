// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <variant>

#include "client/relocalization/anchored_pose.h"
#include "client/relocalization/described_views.h"
#include "client/relocalization/keyframe_rounds.h"
#include "client/relocalization/place_memory.h"
#include "client/relocalization/pose_hypothesis.h"
#include "client/relocalization/reloc_query_state.h"
#include "client/relocalization/verified_path.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

namespace cairn {

/// There is no map yet, or none that the camera is looked for in.
struct Starting {
  bool insists = false;  ///< on a new map, whatever is known of the place
};
/// The camera is known in the map; the latest frames may have failed.
struct Tracking {
  float quality = 0;           ///< share found in the latest frame that did not fail
  int failed_frames = 0;       ///< since then
  bool failed_at_cut = false;  ///< the first of them had nothing in common with the frame before
};
/// The camera has turned away from what the map shows: how it is turned is known, and no more. It may have
/// been carried elsewhere meanwhile, so others are asked, and their word is taken for any map.
struct Turned {
  float quality = 0;  ///< share found in the latest frame that showed the map
};
/// A pose was found by looking for it; it is published when the next frames have confirmed it. Whoever looks
/// everywhere finds something somewhere.
struct Verifying {
  int frames_left = 0;           ///< that must still confirm it
  float needed_quality = 0;      ///< in each of them
  float quality = 0;             ///< share found in the latest
  size_t memories_tried = 0;     ///< before this one
  bool lost_at_cut = false;      ///< as Lost::at_cut
  bool is_out_of_reach = false;  ///< of a camera that moves as it did before
  /// When the verification began, if the place is the tracker's own guess. Such a guess was compared with one
  /// map only; the server compares with all, and its answer about a frame from then on is needed.
  std::optional<Timestamp> answer_needed_from;
};
/// The camera is in the map, most likely, and not known where.
struct Lost {
  size_t memories_tried = 0;
  bool at_cut = false;  ///< the image changed as no hand can move: it may be elsewhere by now
};
using RecoveryState = std::variant<Starting, Tracking, Turned, Verifying, Lost>;

/// A pose of the present frame to search from, and what the search must find to be followed up.
struct PoseStart {
  enum class Reach : uint8_t {
    kNear,   ///< as from a prediction
    kWide,   ///< twice as far
    kQuick,  ///< wide, given up when its cheap stage finds nothing
  };
  SE3 camera_from_map;
  Reach reach = Reach::kWide;
  float quality = 0;  ///< share of the points that must be found, now and in the frames that verify it
  bool is_own_guess = false;  ///< and not what others say
};

struct RecoveryOptions {
  int lost_after_failed_frames = 3;  ///< [frames] in a row
  uint64_t seed = 1;                 ///< of random choices
  float least_quality = 0.13F;       ///< share found of a pose that shows anything
  int fewest_points = 25;            ///< that must be found of a pose that was looked for,
  float verified_quality = 0.4F;     ///< and their share, where nothing else speaks for it
  /// Share of the points that must be found at a place that the server names or where the motion leads: it
  /// may be poorly mapped.
  float hypothesis_quality = 0.25F;
  int verification_frames = 3;  ///< [frames] in a row
  double same_place = 0.03;     ///< [depths] a pose may be off and be right
  uint64_t memories_tried = 3;  ///< candidates of the memory, by successive frames
  /// [s] A camera that has been lost for longer, or has since seen what no map is known of, may have been
  /// carried elsewhere, to a place that looks the same from where it was.
  double still_here = 1.0;
  double server_patience = 0.2;  ///< [s] an answer takes a frame or two
  RelocQueryOptions query = {};
  PlaceMemoryOptions places = {};
  DescribedViewsOptions views = {};
  KeyframeRoundsOptions rounds = {};
  VerifiedPathOptions path = {};
};

/// The pose that a search found.
struct FoundPose {
  SE3 camera_from_map;
  int points = 0;     ///< inliers of the pose
  float quality = 0;  ///< share found of those in sight
};

/// Knows whether the camera is lost, and where it may be looked for then: one state, what it remembers of the
/// maps that it was in, and the relocalization query. It decides nothing about images: the tracker searches
/// from the poses that it names and reports what came of it. Pure; one thread.
class Recovery {
 public:
  Recovery(CameraPtr camera, const RecoveryOptions& options)
      : camera_(std::move(camera)),
        options_(options),
        query_(options.query),
        places_(options.places),
        views_(options.views),
        rounds_(options.rounds),
        path_(options.path) {}

  /// Other values of the same camera, from now on.
  void use_camera(CameraPtr camera) { camera_ = std::move(camera); }

  [[nodiscard]] const RecoveryState& state() const { return state_; }
  template <typename Kind>
  [[nodiscard]] const Kind* as() const {
    return std::get_if<Kind>(&state_);
  }
  [[nodiscard]] bool is_starting() const { return as<Starting>() != nullptr; }
  /// Whether the tracker insists on a new map, whatever is known of the place.
  [[nodiscard]] bool insists() const { return is_starting() && as<Starting>()->insists; }
  [[nodiscard]] bool is_lost() const { return as<Lost>() != nullptr; }

  // What happens to the tracker.

  /// Forgets the map in use; memories of all maps stay.
  void start_over(bool insists);
  /// A map, nothing yet being known of where the camera is in it.
  void enter_map() { state_ = Lost{}; }
  /// The map of one's own seed, begun at this pose; `is_tracked`: it is that of the present frame, of
  /// `time`.
  void begin_map(const AnchoredPose& pose, bool is_tracked, Timestamp time);
  /// The camera was found at the pose `start`, which believe() gave, in the frame of `time`: its verification
  /// begins.
  void begin_verifying(const PoseStart& start, Timestamp time);
  /// The frame shows the map from `pose`, with this share found. True when the pose is to be published: at
  /// once while tracking; of one that is verified, when enough frames have confirmed it and the server does
  /// not say otherwise. `is_leap`: it is farther from where it was expected than a hand moves a camera, and
  /// so says nothing of how this camera moves.
  [[nodiscard]] bool confirm(float quality, const AnchoredPose& pose, Timestamp time, bool is_leap = false);
  /// The frame does not show the map, but how the camera has turned since it was tracked is known.
  void turn_away();
  /// The frame does not show the map; `before` is the frame before, which may have.
  void lose_sight(const FrameImages& before);
  /// The frame does not show the map. `is_cut`: it has nothing in common with the frame before.
  void fail(bool is_cut, Timestamp time);
  /// A frame whose pose was published is good enough to be found again by.
  void remember(const FrameImages& frame, const MapSnapshot& map, const ViewPose& pose,
                std::span<const SeenPoint> points);

  // Where the camera may be.

  /// A frame begins: the poses for it are named from the first on. Those of a lost camera are all that is
  /// known; while the camera was tracked until now, a frame that fails is searched only from where others
  /// say. `near_depth` [map unit] of what is nearest of what was seen last.
  void begin_frame(const MapSnapshot& map, double near_depth, Timestamp time);
  /// Whether the camera can have got to this pose since it was tracked, as far as is known.
  [[nodiscard]] bool is_reachable(const SE3& camera_from_map) const {
    return !region_ || region_->contains(camera_from_map);
  }
  /// The pose of a camera that went on as it did before, with the rotation of `camera_from_map`;
  /// `camera_from_map` itself where nothing tells how it went on.
  [[nodiscard]] SE3 within_reach(const SE3& camera_from_map) const;
  /// The next pose to search `frame` from, in order of what speaks for it, and where the camera can have got
  /// to before where it cannot: where it is if it went on as it did, turned as the `last` pose is; what
  /// others say; while it cannot have gone far, or if there are no others, the views of the points around the
  /// last pose, the memory of places, the pose published last; if there are no others, the keyframes of the
  /// map. Asked for again, what was named before did not show.
  [[nodiscard]] std::optional<PoseStart> next_start(const FrameImages& frame, const MapSnapshot& map,
                                                    const SE3& last, double mean_depth, Timestamp time);
  /// The pose found from `start`, and what must be found in the frames that verify it, if it is to be
  /// followed up; nothing when it is not to be. Where the camera can have got to, less is enough. Where it
  /// cannot, nothing that counts may show from any such place, and it is asked again once that is known: a
  /// structure that repeats looks the same from each of its periods, so turned as there the camera is looked
  /// for within reach.
  [[nodiscard]] std::optional<PoseStart> believe(const PoseStart& start, const FoundPose& found,
                                                 Timestamp time);
  /// The pose by the corners of `frame` and the views remembered around `last`, whatever the state.
  [[nodiscard]] std::optional<SE3> by_corners(const FrameImages& frame, const MapSnapshot& map,
                                              const SE3& last, double mean_depth);

  // The relocalization query. While starting it is made where `may_enter`: another map than one's own to
  // be would be entered.

  /// The frame described, with which way is up in it where that is known, if a query is due; else null.
  [[nodiscard]] std::shared_ptr<const PlaceView> ask(const FrameImages& frame, Timestamp time, bool may_enter,
                                                     const std::optional<UpDirection>& up = {});
  /// Takes the answer to the query, and says what becomes of it. `map`: the one in use, if there is one.
  PlaceUse answered(const std::optional<PoseHypothesis>& hypothesis, std::optional<MapId> map,
                    bool may_enter);
  void left_open() { query_.left_open(); }
  [[nodiscard]] const RelocQueryState& query() const { return query_; }

 private:
  /// What speaks for a pose to search from, in the order in which poses are named. At kRejected it is known
  /// that what others say is wrong.
  enum class Source : uint8_t {
    kContinued,
    kTurned,
    kConfirmed,
    kHypothesis,
    kCorners,
    kMemory,
    kVerified,
    kOutOfReach,
    kRejected,
    kKeyframes,
    kNone
  };

  [[nodiscard]] bool is_looking(bool may_enter) const;
  [[nodiscard]] bool is_asking(bool may_enter) const;
  [[nodiscard]] bool lacks_answer() const;
  [[nodiscard]] bool needs_more(const Verifying& verification, Timestamp time) const;
  [[nodiscard]] bool is_contradicted_by(const PoseHypothesis& place, std::optional<MapId> map) const;
  [[nodiscard]] bool wants(const PoseHypothesis& place, std::optional<MapId> map, bool may_enter) const;
  [[nodiscard]] bool may_be_elsewhere(Timestamp time) const;
  [[nodiscard]] bool was_lost_at_cut() const { return is_lost() && as<Lost>()->at_cut; }
  [[nodiscard]] bool is_worth_trying(Source source, Timestamp time) const;
  [[nodiscard]] size_t next_memory();
  [[nodiscard]] PoseStart next_out_of_reach();
  void compare_within_reach(const PoseStart& found);
  [[nodiscard]] std::optional<SE3> turned_since(const FrameImages& frame, const MapSnapshot& map) const;
  [[nodiscard]] std::optional<PoseStart> start_from(Source source, const FrameImages& frame,
                                                    const MapSnapshot& map, const SE3& last,
                                                    double mean_depth);

  CameraPtr camera_;
  RecoveryOptions options_;
  RecoveryState state_ = Starting{};
  RelocQueryState query_;
  PlaceMemory places_;
  DescribedViews views_;
  KeyframeRounds rounds_;
  VerifiedPath path_;        ///< the last poses published,
  Timestamp verified_time_;  ///< and when the latest was
  TinyImage last_sight_;     ///< of its frame, once the next has failed; empty: another frame came between
  Timestamp now_;            ///< of the present frame
  Timestamp before_;         ///< of the one before
  // Of the present frame:
  std::optional<PlaceView> described_;
  std::optional<ReachableRegion> region_;  ///< where the camera can be, as far as is known
  struct OutOfReach {
    PoseStart start;
    bool is_compared = false;  ///< what shows within reach, with the camera turned so, is known
  };
  std::deque<OutOfReach> out_of_reach_;  ///< that were put off
  bool is_compared_ = false;             ///< of the pose named last
  bool shows_within_reach_ = false;      ///< something, from a pose where the camera can be
  std::optional<SE3> hypothesis_pose_;   ///< the place that others say, taken
  Source source_ = Source::kNone;        ///< of the pose named next
  size_t keyframes_tried_ = 0;
};

}  // namespace cairn
