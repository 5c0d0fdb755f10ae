// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/se3.h"
#include "common/image/patch.h"
#include "common/map/ids.h"
#include "common/map/limits.h"

/// The map as trackers see it: immutable blocks of 64 points or keyframes, shared between revisions (only
/// blocks that changed are new) and between threads without locks. The same types on the server (which cuts
/// its map into blocks) and in a client's replica (which receives them), so that engines and tests run on
/// either without a network.
namespace cairn {

/// Where a point's patch was cut, and what it shows. Only its rays and its normal ever change: when the
/// source camera's calibration turns out to differ from what was believed.
struct PointSource {
  PointId id;
  KeyframeId keyframe;  ///< the keyframe whose image gave the patch
  uint8_t level = 0;    ///< pyramid level of the patch
  Corner corner;        ///< reference pixel, at `level`
  /// Unit rays in the source camera's frame through the reference pixel and through the pixels one to the
  /// right of it and one below it, at `level`: the patch's geometry without the source camera's model.
  Eigen::Vector3f ray_center = Eigen::Vector3f::UnitZ();
  Eigen::Vector3f ray_right = Eigen::Vector3f::UnitZ();
  Eigen::Vector3f ray_down = Eigen::Vector3f::UnitZ();
  /// Unit, of the surface, source camera's frame, towards the camera.
  Eigen::Vector3f normal = -Eigen::Vector3f::UnitZ();
  SourcePatch pixels{};
};

/// Topic PointPatches. Points in order of ascending id; only the newest block of a map is shorter than 64.
struct PatchBlock {
  uint32_t index = 0;    ///< position of the block in the map
  uint64_t version = 0;  ///< grows with each change; compared within an epoch only
  std::vector<PointSource> points;
};

/// From where a point has been seen, which tells a tracker from where it should not expect to see it.
struct PointVisibility {
  /// Unit, from the point to the cameras, map frame; 0 = unknown.
  Eigen::Vector3f mean_direction = Eigen::Vector3f::Zero();
  float min_cosine = -1;   ///< of the angle between mean_direction and the observing directions
  float min_distance = 0;  ///< [map unit] nearest observing camera
  float max_distance = 0;  ///< [map unit] farthest observing camera; 0 = unknown
};

/// Topic PointPositions. Same index and slots as the patch block.
struct PositionBlock {
  uint32_t index = 0;
  uint64_t version = 0;
  /// Bit s: slot s holds a point of the map (a removed point keeps its slot and loses its bit).
  uint64_t live = 0;
  std::vector<Eigen::Vector3f>
      positions;  ///< map frame, as many as the patch block of this revision has points
  std::vector<PointVisibility> visibility;
};

struct KeyframePose {
  KeyframeId id;
  SE3 camera_from_map;
  float mean_depth = 0;  ///< [map unit] of the points measured in it
  bool operator==(const KeyframePose& o) const {
    return id == o.id && mean_depth == o.mean_depth &&
           camera_from_map.rotation().coeffs() == o.camera_from_map.rotation().coeffs() &&
           camera_from_map.translation() == o.camera_from_map.translation();
  }
};

/// Topic KeyframePoses. Slots in order of creation.
struct KeyframeBlock {
  uint32_t index = 0;
  uint64_t version = 0;
  uint64_t live = 0;
  std::vector<KeyframePose> keyframes;
};

/// 64 points ready for the tracker: structure of arrays for the loops over all points of a map, patch
/// vectors, and a bounding sphere to pass over whole blocks that are out of view. Derived from the three
/// topics; immutable.
struct PointBlock {
  uint64_t live = 0;  ///< bit s: slot s holds a point of the map that can be projected
  Eigen::Vector3f center = Eigen::Vector3f::Zero();  ///< of the bounding sphere of the live points
  float radius = 0;
  std::shared_ptr<const PatchBlock> patches;
  std::shared_ptr<const PositionBlock> positions;
  int count = 0;
  std::array<PointId, kBlockSlots> ids{};
  alignas(32) std::array<float, kBlockSlots> x{}, y{}, z{};  ///< map frame
  /// PointVisibility by component, with the sine of the angle; where unknown, cosine -1 and distances 0 and
  /// infinite.
  alignas(32) std::array<float, kBlockSlots> view_x{}, view_y{}, view_z{},
      view_cosine{}, view_sine{}, nearest{}, farthest{};
  /// right x down, map frame: along the patch's normal, as long as the area of one source-level pixel on it.
  alignas(32) std::array<float, kBlockSlots> span_x{}, span_y{}, span_z{};
  /// Map-frame displacement on the patch's plane of one source-level pixel to the right, and one down (PTAM
  /// 2007, 5.2).
  std::array<Eigen::Vector3f, kBlockSlots> right{}, down{};

  [[nodiscard]] const PointSource& source(int slot) const {
    return patches->points[static_cast<size_t>(slot)];
  }
  [[nodiscard]] const PointVisibility& visibility(int slot) const {
    return positions->visibility[static_cast<size_t>(slot)];
  }
  [[nodiscard]] Eigen::Vector3d position(int slot) const {
    const auto s = static_cast<size_t>(slot);
    return {x[s], y[s], z[s]};
  }
};

/// Where a point stands in a snapshot.
struct PointSlot {
  int block = 0;
  int slot = 0;
  bool operator==(const PointSlot&) const = default;
};

/// Which values of a camera are meant: those of a client's camera that is still being calibrated change, and
/// a number goes with them.
struct CameraVersion {
  ClientId client;
  uint32_t camera = 0;   ///< the client's number for it
  uint32_t version = 0;  ///< grows with each change of its values
  bool operator==(const CameraVersion&) const = default;
};

/// One revision of one map.
struct MapSnapshot {
  MapId map;
  std::string name;
  Epoch epoch;
  Revision revision;
  bool metric = false;  ///< whether the map unit is known to be a metre
  std::vector<std::shared_ptr<const PointBlock>> point_blocks;
  std::vector<std::shared_ptr<const KeyframeBlock>> keyframe_blocks;
  /// For each camera that is self-calibrated in this map, the version of its values that this revision was
  /// made with. Whoever tracks on the map with such a camera needs them.
  std::vector<CameraVersion> cameras;

  /// Slot of a live point; nothing when it is unknown or gone. O(log blocks).
  [[nodiscard]] std::optional<PointSlot> find(PointId id) const;
  /// Pose of a live keyframe; null when unknown or gone.
  [[nodiscard]] const KeyframePose* find(KeyframeId id) const;
  /// Live keyframe whose camera centre is nearest to a place; null for a map without keyframes.
  [[nodiscard]] const KeyframePose* nearest_keyframe(const Eigen::Vector3d& center) const;
  [[nodiscard]] size_t point_count() const;
  [[nodiscard]] size_t keyframe_count() const;
};

using MapSnapshotPtr = std::shared_ptr<const MapSnapshot>;

/// Joins the topics of one block. Patch vectors come from the source keyframe's pose in `keyframes`; a point
/// whose source is unknown or whose plane is edge-on loses its live bit in the result's arrays (its patch
/// vectors are zero).
[[nodiscard]] std::shared_ptr<const PointBlock> make_point_block(
    std::shared_ptr<const PatchBlock> patches, std::shared_ptr<const PositionBlock> positions,
    const std::vector<std::shared_ptr<const KeyframeBlock>>& keyframes);

}  // namespace cairn
