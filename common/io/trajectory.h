// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/base/stream_writer.h"
#include "common/base/time.h"
#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

/// "Camera in map" at an instant: the form of trajectory files. Metres (or the map's unit).
struct StampedPose {
  Timestamp time;
  SE3 map_from_camera;
};

/// Consecutive rows in one map. Poses of different maps share no frame.
struct TrajectorySegment {
  MapId map;             ///< none where no map row came before
  std::string map_name;  ///< may be empty
  std::vector<StampedPose> poses;
};

struct Trajectory {
  std::vector<TrajectorySegment> segments;  ///< in file order, none empty
  size_t rows_left_out = 0;                 ///< without a pose: NaN, infinity or a quaternion of zeros
  bool is_of_body = false;  ///< rows as EuRoC has them: of the body that carries the cameras (or of a sensor)
  [[nodiscard]] size_t pose_count() const;
};

/// Reads, told by the content:
///  * TUM rows `t tx ty tz qx qy qz qw` (seconds; Hamilton, x y z w; blanks, tabs or commas between);
///  * EuRoC's and TUM-VI's ground truth and VINS' results, `t,tx,ty,tz,qw,qx,qy,qz[,...]` (nanoseconds,
///  commas);
///  * ORB-SLAM's `t tx ty tz qx qy qz qw` with nanoseconds.
/// A heading, with or without '#', that names a quaternion's columns decides where its w is. '#' begins a
/// comment row; `# map ID NAME` with ID of 32 hex digits begins a segment. Quaternions are normalized. Errors
/// name file and line: kNotFound, kIo, kDamaged (also for a file without a pose).
[[nodiscard]] Result<Trajectory> read_trajectory(const std::filesystem::path& path);

/// Writes a TUM trajectory row by row, in a thread of its own (StreamWriter): a disk that hangs or a pipe
/// that nobody reads holds nobody up. Each row is in the file soon after append(). Not thread-safe; movable.
class TrajectoryWriter {
 public:
  /// Truncates or creates the file. Error kIo.
  [[nodiscard]] static Result<TrajectoryWriter> open(const std::filesystem::path& path);

  /// Appends a row, and before it `# map ID NAME` when the map is not that of the row before. Time to the
  /// nanosecond, 9 decimals, qw >= 0. The first fault so far, kIo (disk full, rows left out); the rows after
  /// it are tried all the same.
  [[nodiscard]] Status append(const MapId& map, std::string_view map_name, const StampedPose& pose);
  /// Completes the file as StreamWriter::finish() does. Without it, the destructor completes a regular file.
  [[nodiscard]] Status finish(
      DrainPatience patience = {}, const std::function<bool()>& stop_requested = [] { return false; });

 private:
  explicit TrajectoryWriter(std::unique_ptr<StreamWriter> stream) : stream_(std::move(stream)) {}

  std::unique_ptr<StreamWriter> stream_;
  std::optional<MapId> current_map_;
};

}  // namespace cairn
