// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/se3.h"
#include "common/io/trajectory.h"

namespace cairn {

/// The kind of transform that fits an estimate to the truth before they are compared: kSim3 for one camera
/// without a known scale, kSe3 for metric.
enum class Alignment { kSim3, kSe3 };
/// The unit of --delta of the relative error: matched poses, metres along the truth, or seconds.
enum class DeltaUnit { kFrames, kMetres, kSeconds };

/// Truth and estimate at the same instant, each in its own frame.
struct PosePair {
  Timestamp time;  ///< of the estimate
  SE3 truth_from_camera;
  SE3 map_from_camera;
};

struct ErrorStatistics {
  size_t count = 0;
  double rmse = 0;
  double mean = 0;
  double median = 0;
  double stddev = 0;
  double min = 0;
  double max = 0;
};

struct TimedError {
  Timestamp time;
  double value = 0;
};

/// The part of an estimate that lies in one map (all its segments), with the motion that fits it to the
/// truth.
struct MapAlignment {
  MapId map;
  std::string name;
  std::vector<StampedPose> poses;  ///< all, in time order
  std::vector<PosePair> pairs;     ///< those with a truth, in time order
  bool is_aligned = false;  ///< false for fewer than 3 pairs or positions on a line; such a map has no error
  Similarity3 truth_from_map;
  ErrorStatistics translation;  ///< absolute error within this map [m]
};

/// Estimate against truth. Maps share no frame and no scale, so each is aligned by itself.
struct Comparison {
  std::vector<MapAlignment> maps;  ///< in order of first appearance
  size_t truth_poses = 0;
  size_t estimate_poses = 0;
  size_t matched = 0;              ///< pairs in aligned maps
  size_t unaligned = 0;            ///< pairs in maps that cannot be aligned: they count nowhere else
  double path_length = 0;          ///< of the truth through the matched poses of each map [m]
  std::vector<std::string> notes;  ///< for people: what was left out of the files, or is suspected of them
};

struct AbsoluteError {
  ErrorStatistics translation;     ///< over the pairs of all aligned maps [m]
  std::vector<TimedError> errors;  ///< in time order [m]
};

struct RelativeError {
  ErrorStatistics translation;     ///< [m]
  ErrorStatistics rotation;        ///< [rad]
  std::vector<TimedError> errors;  ///< translation [m], at the time of the pair's second pose
};

/// Each pose of the shorter list takes the nearest in time of the longer one if not further than
/// `max_difference` [s]; so does evo (sync.associate_trajectories). Both in time order; result in time order
/// of the shorter. Returns index pairs (truth, estimate).
[[nodiscard]] std::vector<std::pair<size_t, size_t>> associate(std::span<const StampedPose> truth,
                                                               std::span<const StampedPose> estimate,
                                                               double max_difference);

/// Associates and aligns (Umeyama on camera centres, per map). kDegenerate when no time matches or no map can
/// be aligned; the message says which and what the times are.
[[nodiscard]] Result<Comparison> compare(const Trajectory& truth, const Trajectory& estimate,
                                         double max_difference, Alignment alignment);

/// Absolute trajectory error (Sturm et al., IROS 2012, eq. 3): distance of camera centres after alignment.
[[nodiscard]] AbsoluteError absolute_error(const Comparison& comparison);

/// Relative pose error (Sturm et al., IROS 2012, eq. 1) over all pairs i < j of one map that lie `delta`
/// apart, j the nearest to that and within 10 % of it, as `evo_rpe --all_pairs`. The estimate is scaled as
/// aligned. kDegenerate when there is no such pair.
[[nodiscard]] Result<RelativeError> relative_error(const Comparison& comparison, double delta,
                                                   DeltaUnit unit);

/// Statistics of a list of errors; all zero for an empty one.
[[nodiscard]] ErrorStatistics summarize(std::vector<double> errors);

}  // namespace cairn
