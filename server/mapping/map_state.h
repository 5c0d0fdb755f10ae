// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/geometry/up_direction.h"
#include "common/image/corners.h"
#include "common/image/pyramid.h"
#include "common/image/still_mask.h"
#include "common/map/ids.h"
#include "common/map/snapshot.h"
#include "server/mapping/map_camera.h"

/// The map as the map maker holds it: keyframes, points and the measurements that join them. Plain values
/// with the invariants of the joins kept by MapState; no policy. One writer, no locks.
namespace cairn {

/// Number of blocks that hold so many items.
[[nodiscard]] constexpr size_t block_count(size_t items) {
  return (items + kBlockSlots - 1) / kBlockSlots;
}

/// Pyramid and corners, which are computed once from a keyframe's image.
struct KeyframeImages {
  Pyramid pyramid;
  std::array<CornerList, kPyramidLevels> corners;

  [[nodiscard]] GrayView level(int l) const { return pyramid.level(l).view(); }
  [[nodiscard]] size_t bytes() const;
};

/// Roughly what KeyframeImages::bytes() will be: the pyramid, and a quarter of that for corners.
[[nodiscard]] size_t expected_image_bytes(const Camera& camera);

/// The pyramid of an image and its corners (`kFastThresholds`), without those of what stands still.
[[nodiscard]] std::shared_ptr<const KeyframeImages> prepare_images(const GrayView& image,
                                                                   const StillMaskPtr& still);

/// Candidates at which new points may be made at a level (PTAM r114): corners as `options` ask for them, with
/// room for their patch. They are needed once in a keyframe's life, so they are not kept.
[[nodiscard]] std::vector<Candidate> point_candidates(const KeyframeImages& images, int level,
                                                      const TwoViewPointOptions& options);

/// A point seen in a keyframe.
struct Measurement {
  PointId point;
  uint8_t level = 0;                                ///< sigma = 2^level px
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  ///< level-0 px (distorted, as seen)

  [[nodiscard]] double inverse_sigma() const { return 1.0 / (1 << level); }
};

struct MapKeyframe {
  KeyframeId id;
  KeyframeId reference;  ///< whose corrections this keyframe rides on; none for the first
  CameraPtr camera;
  int estimated_camera = -1;  ///< index in MapState::cameras(); -1: its values are exact
  Timestamp time;
  SE3 camera_from_map;
  std::shared_ptr<const KeyframeImages>
      images;                             ///< null once the keyframe is removed, or while they are evicted
  StillMaskPtr still;                     ///< what stands still in them; null: nothing
  std::optional<UpDirection> up;          ///< in the camera's axes; nothing: not known
  std::vector<Measurement> measurements;  ///< ascending by point, each point at most once
  std::vector<PointId> given_up;  ///< ascending: searched without success or dropped as outliers; not retried
  bool adds_only = false;         ///< KeyframeInput::adds_only: tells nothing against what others have made
  double mean_depth = 0;          ///< [map unit] of the points measured here, as are the two below
  double near_depth = 0;          ///< 5th percentile
  double far_depth = 0;           ///< 95th percentile
  bool live = true;
};

/// Whether the images of a keyframe have been evicted and can be paged in.
[[nodiscard]] inline bool lacks_images(const MapKeyframe& keyframe) {
  return keyframe.live && keyframe.images == nullptr;
}

struct MapPoint {
  PointId id;
  std::shared_ptr<const PointSource> source;           ///< null once it is removed: most points ever made are
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
  std::vector<KeyframeId> observers;                   ///< ascending
  /// Number of keyframes in which it should have been seen and was searched, beside those that made it.
  /// Keyframes that add only count if they show it.
  int attempts = 0;
  int found = 0;  ///< of these, with success
  bool live = true;
};

/// The source of a point as blocks of points have it: a removed point keeps its place there, with some
/// source.
[[nodiscard]] PointSource source_in_block(const MapPoint& point);

/// The new ids that a compaction has given, by the old ones.
struct Renumbering {
  std::vector<KeyframeId> keyframes;  ///< by old id - 1; none: it had been removed
  std::vector<PointId> points;

  /// The new id; none if the old one had been removed or never was.
  [[nodiscard]] KeyframeId of(KeyframeId old) const {
    return old && old.value <= keyframes.size() ? keyframes[old.value - 1] : KeyframeId{};
  }
  [[nodiscard]] PointId of(PointId old) const {
    return old && old.value <= points.size() ? points[old.value - 1] : PointId{};
  }
};

/// A camera that is self-calibrated, as it was when an adjustment began.
struct CutCamera {
  int index = 0;  ///< in MapState::cameras()
  CameraVersion version;
  KeyframeCount keyframes;
};

/// Ids are dense: keyframe k is keyframes()[k - 1], point p is points()[p - 1]; removed ones keep their place
/// and lose `live`. Passing an id that was never given out is a programming error.
class MapState {
 public:
  MapState() = default;
  /// Makes a map from its parts. Precondition: ids are dense, measurements sound and of live points, and the
  /// self-calibrated cameras are those that the keyframes name. Observers and what else can be derived are
  /// set here.
  MapState(std::vector<MapKeyframe> keyframes, std::vector<MapPoint> points, std::vector<MapCamera> cameras);

  [[nodiscard]] const std::vector<MapKeyframe>& keyframes() const { return keyframes_; }
  [[nodiscard]] const std::vector<MapPoint>& points() const { return points_; }
  [[nodiscard]] MapKeyframe& keyframe(KeyframeId id) { return keyframes_[id.value - 1]; }
  [[nodiscard]] const MapKeyframe& keyframe(KeyframeId id) const { return keyframes_[id.value - 1]; }
  [[nodiscard]] MapPoint& point(PointId id) { return points_[id.value - 1]; }
  [[nodiscard]] const MapPoint& point(PointId id) const { return points_[id.value - 1]; }
  [[nodiscard]] bool is_live(KeyframeId id) const {
    return id && id.value <= keyframes_.size() && keyframe(id).live;
  }
  [[nodiscard]] bool is_live(PointId id) const { return id && id.value <= points_.size() && point(id).live; }
  /// The cameras that are self-calibrated.
  [[nodiscard]] const std::vector<MapCamera>& cameras() const { return cameras_; }
  [[nodiscard]] size_t live_keyframes() const;
  [[nodiscard]] size_t live_points() const { return live_points_.size(); }
  [[nodiscard]] const std::vector<PointId>& live_point_ids() const { return live_points_; }  ///< ascending

  /// Index of a self-calibrated camera; -1 while no keyframe has come of it.
  [[nodiscard]] int camera_index(const CameraPrior& prior) const;
  /// Takes in a camera that has no index yet, and returns its index. A map holds kMaxCalibratedCameras:
  /// beyond these the new one takes the place of one that is known or, with none, of the one with fewest
  /// keyframes, whose keyframes keep their camera as it is.
  int add_camera(const CameraPtr& camera, const CameraPrior& prior);
  /// Whether the keyframe's camera is exact, or known by now.
  [[nodiscard]] bool has_known_camera(const MapKeyframe& keyframe) const;
  /// Number of keyframes of a self-calibrated camera.
  [[nodiscard]] KeyframeCount keyframes_of(int camera) const;
  /// Takes in what an adjustment has found of a camera, and gives it to the camera's keyframes. Does nothing
  /// if another camera has its place by now.
  void update_camera(const CutCamera& cut, const FreeCamera& adjusted, const SelfCalibrationOptions& options);
  /// Aims the patches of cameras anew that have moved by what a search feels, or are known from now on.
  /// Returns true when points searched in vain may be found now: nothing is given up any more then.
  bool follow_cameras(const SelfCalibrationOptions& options);
  /// How often patches were aimed anew.
  [[nodiscard]] uint64_t aims() const { return aims_; }
  /// Publishes the cameras as they are now, in new versions where the change can be seen.
  void publish_cameras(const MapMakerOptions& options);
  /// For a map put together from its record: counts its cameras as they are now as published.
  void take_cameras_as_published(const SelfCalibrationOptions& options);

  /// Takes in a keyframe without measurements; its id is set here.
  KeyframeId add_keyframe(MapKeyframe keyframe);
  /// Takes in a point; its id is set here.
  PointId add_point(const PointSource& source, const Eigen::Vector3d& position);
  /// Joins a live point and a live keyframe; an existing measurement of the pair is replaced.
  void add_measurement(KeyframeId keyframe, const Measurement& measurement);
  /// Removes a measurement for good: the pair is not searched again. A point left with fewer than two
  /// observers, or without its source keyframe's measurement, is removed.
  void drop_measurement(KeyframeId keyframe, PointId point);
  void give_up(KeyframeId keyframe, PointId point);
  /// Lets the points of a published block share its sources instead of copies of their own. Precondition: the
  /// block was made of this map as it is.
  void share_sources(const std::shared_ptr<const PatchBlock>& block);
  void remove_point(PointId id);  ///< its position becomes the origin
  /// Removes a keyframe, its measurements and image. Points that lose their source or have too few observers
  /// go too.
  void remove_keyframe(KeyframeId id);

  [[nodiscard]] const Measurement* find_measurement(KeyframeId keyframe, PointId point) const;
  [[nodiscard]] bool has_given_up(KeyframeId keyframe, PointId point) const;

  /// Frees the places of removed keyframes and points: ids are dense anew, in the order of before. Whatever
  /// else knows ids of this map must follow, and readers must be in another epoch.
  [[nodiscard]] Renumbering compact();

  /// Refreshes the depth figures of a keyframe from its measurements.
  void update_depths(KeyframeId id);
  /// Number of points that each keyframe shares with the given set, indexed by id - 1.
  [[nodiscard]] std::vector<int> shared_points(const std::vector<Measurement>& measurements) const;

  /// Applies a change of frame and unit to everything: points by `new_from_old`, cameras accordingly.
  void transform(const Similarity3& new_from_old);

 private:
  /// Index in cameras_ at which another may go.
  [[nodiscard]] size_t free_place() const;
  /// Aims anew the patches whose source keyframe has one of the chosen cameras (by index).
  void aim_patches(const std::vector<bool>& chosen);

  std::vector<MapCamera> cameras_;
  std::vector<MapKeyframe> keyframes_;
  std::vector<MapPoint> points_;
  std::vector<PointId> live_points_;  ///< ascending
  uint64_t aims_ = 0;
};

}  // namespace cairn
