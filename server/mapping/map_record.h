// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "server/mapping/map_maker.h"
#include "server/mapping/map_state.h"

/// A map's record: what has to be kept of it so that it goes on as if nothing had happened. It has plain
/// values, and nothing that can be derived. A record may hold a whole map or only what has changed; applying
/// the changes in order to a whole gives a whole again.
namespace cairn {

/// A camera that is self-calibrated in the map. What was published of it is not kept: after a restart its
/// present values count as published.
struct CalibratedCameraRecord {
  int index = 0;
  MapCamera camera;
};

/// A keyframe but for its image and measurements.
struct KeyframeRecord {
  KeyframeId id;
  KeyframeId reference;
  CameraPtr camera;
  Timestamp time;
  SE3 camera_from_map;
  double mean_depth = 0;  ///< [map unit] as the two below: see MapKeyframe
  double near_depth = 0;
  double far_depth = 0;
  bool live = true;
  /// Index of the CalibratedCameraRecord whose values count; -1: `camera` is exact.
  int estimated_camera = -1;
  StillMaskPtr still = {};  ///< MapKeyframe::still
  std::optional<UpDirection> up = {};
  bool adds_only = false;  ///< MapKeyframe::adds_only
};

struct MeasurementsRecord {
  KeyframeId keyframe;
  std::vector<Measurement> measurements;  ///< ascending by point
  std::vector<PointId> given_up;          ///< ascending
};

/// The image that a keyframe was made of (pyramid level 0).
struct ImageRecord {
  KeyframeId keyframe;
  GrayImagePtr image;
};

/// Sources of the points with ids 64 block + 1 .. 64 block + size(). They change only when a self-calibrated
/// camera has moved so far that patches are aimed anew.
struct SourcesRecord {
  uint32_t block = 0;
  std::vector<PointSource> points;
};

/// The part of points that changes; slots as in SourcesRecord.
struct PositionsRecord {
  struct Point {
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< map frame
    int attempts = 0;
    int found = 0;
    bool live = true;
  };
  uint32_t block = 0;
  std::vector<Point> points;
};

/// What the two-view start has fixed for the map's whole life.
struct FoundationRecord {
  double min_distance_over_depth = 0;  ///< KeyframeSpacing
  bool plane_aligned = false;
};

/// A keyframe for which points are still to be made: from `next_candidate` of `next_level` on, an index into
/// the map maker's order of levels.
struct PendingKeyframe {
  KeyframeId id;
  size_t next_level = 0;
  size_t next_candidate = 0;
  int made = 0;
  std::optional<Extent> extent = {};  ///< KeyframeInput::extent
};

/// Work that is due.
struct WorkRecord {
  std::vector<PendingKeyframe> wanting_points;
  std::vector<PointId> wanting_observers;  ///< new points, to be found in old keyframes
  KeyframeId newest;                       ///< around which the local adjustment goes
  bool local_adjustment_due = false;
  bool upkeep_due = false;
  bool global_adjustment_due = false;
};

struct MapRecord {
  size_t keyframe_count = 0;  ///< ever made, of the map that this is or belongs to
  size_t point_count = 0;
  std::optional<FoundationRecord> foundation;
  std::optional<WorkRecord> work;
  std::vector<CalibratedCameraRecord> calibrated_cameras;
  std::vector<KeyframeRecord> keyframes;
  std::vector<MeasurementsRecord> measurements;
  std::vector<ImageRecord> images;         ///< of new keyframes
  std::vector<KeyframeId> removed_images;  ///< of keyframes that were removed
  std::vector<SourcesRecord> sources;
  std::vector<PositionsRecord> positions;

  [[nodiscard]] bool empty() const {
    return !foundation && !work && calibrated_cameras.empty() && keyframes.empty() && measurements.empty() &&
           images.empty() && removed_images.empty() && sources.empty() && positions.empty();
  }
};

/// A map put together from its record, and what had to be left out of it, one line for a person each. A
/// keyframe without image or measurements is removed, as are points without source or position, and what
/// refers to them.
struct AssembledMap {
  MapState state;  ///< whose cameras are not published yet (MapState::take_cameras_as_published)
  std::vector<std::string> repairs;
};

/// Puts a map together from its record. Error kDamaged when what is left is no map: the first keyframe or the
/// foundation is missing, or fewer than two keyframes remain. Takes the images' time, unless these are left
/// out: some milliseconds a keyframe.
[[nodiscard]] Result<AssembledMap> assemble_map(const MapRecord& record, RestoredImages images);

/// Tells what has changed in a map since it was asked last, by digests of what it gave out then, so that
/// nothing that changes the map needs to know. Not thread-safe.
class MapRecorder {
 public:
  /// Returns what has changed since the last call; the first time, everything.
  [[nodiscard]] MapRecord take(const MapState& map, const FoundationRecord& foundation,
                               const WorkRecord& work);
  /// Forgets what was given out, which has been lost: the next take() returns everything.
  void reset() { *this = MapRecorder(); }
  [[nodiscard]] bool has_given_image(KeyframeId id) const {
    return id.value <= has_image_.size() && has_image_[id.value - 1];
  }

 private:
  std::vector<uint64_t> cameras_;    ///< digests by index
  std::vector<uint64_t> keyframes_;  ///< digests by id - 1, as the next
  std::vector<uint64_t> measurements_;
  std::vector<bool> has_image_;
  std::vector<uint64_t> positions_;  ///< digests by block
  size_t sources_ = 0;               ///< points whose sources were given out
  uint64_t aims_ = 0;                ///< MapState::aims() when they were given out
  uint64_t work_ = 0;
  bool has_foundation_ = false;
};

}  // namespace cairn
