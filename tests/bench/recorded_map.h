// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/tracking/tracker.h"
#include "common/geometry/alignment.h"
#include "common/io/trajectory.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/place_index.h"

/// A map made of the first frames of a recording by the engines alone, and the truth to judge poses in it by.
namespace cairn {

[[nodiscard]] double thread_cpu_ms();
/// p in 0..1; 0 for no values.
[[nodiscard]] double percentile(std::vector<double> values, double p);

/// The camera of `file`, or, if that is empty, of the file beside the source.
[[nodiscard]] Result<CameraPtr> choose_camera(const std::string& source, const std::string& file);

/// Builds a map as cairn-engine-run does.
class Mapping {
 public:
  Mapping(CameraPtr camera, MapId map, uint64_t seed);

  void frame(const Frame& frame);
  /// Null without a map.
  [[nodiscard]] const MapMaker* maker() const { return maker_.get(); }
  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  /// The poses that the tracker gave.
  [[nodiscard]] const std::vector<StampedPose>& live() const { return live_; }

 private:
  void seed(const SeedProposal& proposal);
  void work();

  CameraPtr camera_;
  MapId map_;
  TrackerOptions tracker_options_;
  MapMakerOptions maker_options_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<MapMaker> maker_;
  MapSnapshotPtr snapshot_;
  std::vector<StampedPose> live_;
};

/// The map of the first `frames` of a source.
[[nodiscard]] Result<IndexedMapPtr> map_beginning(FrameSource* source, size_t frames, Mapping* mapping);

/// Maps recordings of other places, to be searched too: from all of their frames. Ids count on from `first`.
[[nodiscard]] Status map_others(const std::vector<std::string>& sources, uint8_t first, uint64_t seed,
                                PlaceIndex* index);

/// Exact poses by time.
class Truth {
 public:
  explicit Truth(const Trajectory& trajectory);
  /// Null: none near enough.
  [[nodiscard]] const SE3* at(Timestamp time) const;

 private:
  std::map<Timestamp, SE3> poses_;
};

/// What takes a map to its truth, from the poses of its making.
[[nodiscard]] Result<Similarity3> align(const std::vector<StampedPose>& live, const Truth& truth);

/// How far a pose is from the truth.
struct Offset {
  double metres = 0;
  double degrees = 0;
  [[nodiscard]] bool is_right(double tolerance) const { return metres <= tolerance && degrees <= 5; }
};
[[nodiscard]] Offset compare(const Similarity3& truth_from_map, const SE3& camera_from_map, const SE3& exact);

}  // namespace cairn
