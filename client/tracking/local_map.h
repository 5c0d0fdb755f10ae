// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "client/tracking/frame_result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/patch.h"
#include "common/map/snapshot.h"

namespace cairn {

/// Ids of a tracker's own keyframes and points have this bit; the server's count up from 1.
inline constexpr uint64_t kLocalBit = uint64_t{1} << 62;
[[nodiscard]] constexpr bool is_local(PointId id) {
  return (id.value & kLocalBit) != 0;
}
[[nodiscard]] constexpr bool is_local(KeyframeId id) {
  return (id.value & kLocalBit) != 0;
}

/// A point whose depth the tracker has estimated by itself, in the frame of the map.
struct LocalPoint {
  uint64_t number = 0;  ///< the tracker's, unique
  uint8_t level = 0;    ///< pyramid level of the patch
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Vector3d seen_from = Eigen::Vector3d::Zero();  ///< camera centre whose image gave the patch
  /// One pixel of the level to the right of the patch's centre, and one down, on its surface.
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  SourcePatch pixels{};
};

/// A measurement of a point in a frame that is proposed.
struct LocalMeasurement {
  PointId id;           ///< of the map, the tracker's own included; none: `number`
  uint64_t number = 0;  ///< the LocalPoint that it is, or may become
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  ///< level 0
  double sigma = 1;                                 ///< [px]
};

struct LocalMapOptions {
  /// [ms] A server that is there and not overloaded has answered by then.
  std::chrono::milliseconds answer_awaited{300};
  /// [ms] The server's map shows a keyframe before it has its new points.
  std::chrono::milliseconds taken_over{1000};
  /// [ms] What has not been seen in the server's map by then was removed from it again.
  std::chrono::milliseconds overtaken{10000};
  std::chrono::milliseconds spacing{250};  ///< [ms] of keyframes while answers are overdue
  /// An adjustment changes the size of a whole map by less than drift does, which is some hundredths.
  double same_scale = 0.1;
  uint64_t most_keyframes = 240;  ///< a keyframe each quarter of a second for a minute
  uint64_t most_points = 6000;    ///< 600 bytes each
  uint64_t most_measured = 16;    ///< the newest keyframes, of which it is known what was measured in them
  /// Keyframes that an adjustment moves. As PTAM's five, where each is a tenth of the depth from the last:
  /// these come twice as often.
  uint64_t moving = 8;
  /// [rad] Two rays that differ by less than two degrees say less of a depth than all the frames in between
  /// have said.
  double least_parallax = 0.035;
  int adjustment_iterations = 10;  ///< of Levenberg-Marquardt
  int fewest_fixed_points = 3;     ///< fewer do not hold an adjustment: its oldest keyframe stays
};

/// The map that a tracker makes by itself while the server does not answer: the keyframes that it has
/// proposed and points of its own, each seen from one of them. A keyframe hangs on the one that it was
/// proposed against, so all of them ride on adjustments of the server's map. Unanswered
/// keyframes count once an answer is overdue; soon after the server has taken it in, or refused it, the
/// server's map serves in its place. Pure; bounded in number; one thread; equal inputs give equal bytes.
class LocalMap {
 public:
  explicit LocalMap(const LocalMapOptions& options) : options_(options) {}

  void clear();
  /// The camera is known in this map: what hangs on another is forgotten. Until then it stays, for a map in
  /// which the camera is not found is left again.
  void settle_in(MapId map);

  /// A frame was proposed as a keyframe: these points are known in it, some of them maybe already from an
  /// earlier one.
  void propose(const KeyframeProposal& proposal, const SE3& camera_from_map, float mean_depth, Timestamp time,
               std::span<const LocalPoint> points, std::span<const LocalMeasurement> measurements);
  /// Adjusts the keyframes proposed last, and the points that they see from far enough apart, to what was
  /// measured in them; older ones and the server's map stay (PTAM, section 6.3: local adjustment). Nothing
  /// happens before a map was extended. Returns the newest keyframe's camera_from_reference then; nothing
  /// where there was nothing to adjust or it did not succeed.
  [[nodiscard]] std::optional<SE3> adjust(const CameraPtr& camera);
  /// The server's word: what keyframe it has become, or that it was refused.
  void answered(uint64_t number, std::optional<KeyframeId> keyframe);

  /// Lets time pass until a frame. The numbers of the points that have come to count are appended.
  void advance(Timestamp time, std::vector<uint64_t>* counted);
  /// The server's map together with what counts; the server's own where nothing does, or where it is another
  /// map. In another epoch (the server was started anew) what hangs on keyframes that are still there stays,
  /// unless lengths mean something else in it. The same revision and the same keyframes give the same object.
  [[nodiscard]] MapSnapshotPtr extend(const MapSnapshotPtr& map);

  /// Whether answers are overdue.
  [[nodiscard]] bool is_overdue() const;
  /// Whether a frame of this time may be proposed: there is room for the keyframes of a minute, and while
  /// answers are overdue they are `spacing` apart.
  [[nodiscard]] bool has_room(Timestamp time) const;
  /// The number of the proposal that a keyframe of the tracker's own was; 0 for one of the server's map.
  [[nodiscard]] static uint64_t number_of(KeyframeId id) { return is_local(id) ? id.value & ~kLocalBit : 0; }

  [[nodiscard]] size_t keyframe_count() const { return keyframes_.size(); }
  [[nodiscard]] size_t point_count() const;

 private:
  /// Up to 64 points of a keyframe.
  struct Block {
    std::shared_ptr<const PatchBlock> patches;
    std::vector<uint64_t> numbers;
    std::vector<Eigen::Vector3d> positions;  ///< in the keyframe's frame, as
    std::vector<Eigen::Vector3d> seen_from;  ///< where the patches were seen from
  };
  struct Keyframe {
    KeyframeId id;
    KeyframeId reference;  ///< of the server's map, or one of these
    SE3 camera_from_reference;
    float mean_depth = 0;
    Timestamp time;
    bool counts = false;
    std::optional<Timestamp> answered;
    KeyframeId became;               ///< none: refused
    std::optional<Timestamp> shown;  ///< since when the server's map serves in its place
    std::vector<Block> blocks;
    std::vector<LocalMeasurement> measurements;  ///< of the newest keyframes only
    SE3 camera_from_map;                         ///< in the revision extended last
    bool has_pose = false;                       ///< in it
  };

  class Adjustment;

  [[nodiscard]] Keyframe* find(KeyframeId id);
  [[nodiscard]] bool has_point(uint64_t number) const;
  void add_points(const SE3& camera_from_map, std::span<const LocalPoint> points, Keyframe* keyframe);
  void drop(size_t i);
  [[nodiscard]] const SE3* pose_of(KeyframeId id);
  void drop_points_beyond_limit();
  void aim(const MapSnapshot& map);
  void put_points(MapSnapshot* map) const;

  LocalMapOptions options_;
  std::vector<Keyframe> keyframes_;  ///< in order of their numbers
  uint64_t points_made_ = 0;         ///< ever
  Timestamp now_;
  MapSnapshotPtr base_;      ///< extended last
  MapSnapshotPtr extended_;  ///< from it; null: to be made anew
};

}  // namespace cairn
