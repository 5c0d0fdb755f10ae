// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/metrics.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "common/geometry/alignment.h"
#include "common/io/text.h"

namespace cairn {
namespace {

bool is_earlier(const StampedPose& a, const StampedPose& b) {
  return a.time < b.time;
}

std::vector<StampedPose> all_poses(const Trajectory& trajectory) {
  std::vector<StampedPose> poses;
  for (const auto& segment : trajectory.segments)
    poses.insert(poses.end(), segment.poses.begin(), segment.poses.end());
  std::stable_sort(poses.begin(), poses.end(), is_earlier);
  return poses;
}

/// Index of the pose nearest in time; `poses` in time order and not empty.
size_t nearest(std::span<const StampedPose> poses, Timestamp time) {
  const auto after = std::lower_bound(poses.begin(), poses.end(), StampedPose{time, {}}, is_earlier);
  const auto index = static_cast<size_t>(after - poses.begin());
  if (index == 0) return 0;
  if (index == poses.size()) return index - 1;
  return poses[index].time - time < time - poses[index - 1].time ? index : index - 1;
}

/// The estimate with all segments in one time order; `map_of` says in which map each pose lies.
struct FlatEstimate {
  std::vector<MapAlignment> maps;
  std::vector<StampedPose> poses;
  std::vector<size_t> map_of;
};

FlatEstimate flatten(const Trajectory& estimate) {
  FlatEstimate flat;
  std::map<MapId, size_t> index_of;
  std::vector<std::pair<StampedPose, size_t>> tagged;
  for (const auto& segment : estimate.segments) {
    const auto [at, is_new] = index_of.emplace(segment.map, flat.maps.size());
    if (is_new) flat.maps.emplace_back().map = segment.map;
    flat.maps[at->second].name = segment.map_name;
    for (const auto& pose : segment.poses) tagged.emplace_back(pose, at->second);
  }
  std::stable_sort(tagged.begin(), tagged.end(),
                   [](const auto& a, const auto& b) { return is_earlier(a.first, b.first); });
  for (const auto& [pose, map] : tagged) {
    flat.poses.push_back(pose);
    flat.map_of.push_back(map);
    flat.maps[map].poses.push_back(pose);
  }
  return flat;
}

double pair_error(const MapAlignment& map, const PosePair& pair) {
  return (pair.truth_from_camera.translation() - map.truth_from_map * pair.map_from_camera.translation())
      .norm();
}

/// Fits the map to the truth; leaves it unaligned where the positions do not determine the motion.
void align(MapAlignment& map, Alignment alignment) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const auto& pair : map.pairs) {
    from.push_back(pair.map_from_camera.translation());
    to.push_back(pair.truth_from_camera.translation());
  }
  const auto motion = align_points(from, to, alignment == Alignment::kSim3);
  if (!motion) return;
  map.is_aligned = true;
  map.truth_from_map = *motion;
  std::vector<double> errors;
  for (const auto& pair : map.pairs) errors.push_back(pair_error(map, pair));
  map.translation = summarize(std::move(errors));
}

std::string span_of(std::span<const StampedPose> poses) {
  return format_timestamp(poses.front().time) + " .. " + format_timestamp(poses.back().time) + " s";
}

double step_length(const MapAlignment& map, size_t i) {
  return (map.pairs[i].truth_from_camera.translation() - map.pairs[i - 1].truth_from_camera.translation())
      .norm();
}

/// How far along its map each pair is, in the unit of delta; ascending.
std::vector<double> stations(const MapAlignment& map, DeltaUnit unit) {
  std::vector<double> at(map.pairs.size(), 0.0);
  for (size_t i = 1; i < at.size(); ++i) {
    const double step = unit == DeltaUnit::kFrames ? 1.0
                        : unit == DeltaUnit::kSeconds
                            ? seconds_between(map.pairs[i].time, map.pairs[i - 1].time)
                            : step_length(map, i);
    at[i] = at[i - 1] + step;
  }
  return at;
}

/// The index after `i` whose station is nearest to at[i] + delta, or 0 if none is within 10 % of delta.
size_t partner(const std::vector<double>& at, size_t i, double delta) {
  constexpr double kTolerance = 0.1;
  const double wanted = at[i] + delta;
  auto j = static_cast<size_t>(
      std::lower_bound(at.begin() + static_cast<ptrdiff_t>(i) + 1, at.end(), wanted) - at.begin());
  if (j == at.size() || (j > i + 1 && wanted - at[j - 1] <= at[j] - wanted)) --j;
  return j > i && std::abs(at[j] - wanted) <= kTolerance * delta ? j : 0;
}

}  // namespace

std::vector<std::pair<size_t, size_t>> associate(std::span<const StampedPose> truth,
                                                 std::span<const StampedPose> estimate,
                                                 double max_difference) {
  std::vector<std::pair<size_t, size_t>> matches;
  const bool by_truth = truth.size() <= estimate.size();
  const auto shorter = by_truth ? truth : estimate;
  const auto longer = by_truth ? estimate : truth;
  if (shorter.empty()) return matches;
  for (size_t i = 0; i < shorter.size(); ++i) {
    const size_t j = nearest(longer, shorter[i].time);
    if (std::abs(seconds_between(longer[j].time, shorter[i].time)) > max_difference) continue;
    matches.emplace_back(by_truth ? i : j, by_truth ? j : i);
  }
  return matches;
}

Result<Comparison> compare(const Trajectory& truth, const Trajectory& estimate, double max_difference,
                           Alignment alignment) {
  const auto truth_poses = all_poses(truth);
  auto flat = flatten(estimate);
  const auto matches = associate(truth_poses, flat.poses, max_difference);
  if (matches.empty()) {
    return fail(ErrorCode::kDegenerate, "no time of the estimate (" + span_of(flat.poses) + ") is within " +
                                            std::to_string(max_difference) + " s of one of the truth (" +
                                            span_of(truth_poses) + "); see --t-max-diff");
  }
  for (const auto& [i, j] : matches) {
    flat.maps[flat.map_of[j]].pairs.push_back(
        {flat.poses[j].time, truth_poses[i].map_from_camera, flat.poses[j].map_from_camera});
  }
  Comparison comparison;
  comparison.truth_poses = truth_poses.size();
  comparison.estimate_poses = flat.poses.size();
  for (auto& map : flat.maps) {
    align(map, alignment);
    (map.is_aligned ? comparison.matched : comparison.unaligned) += map.pairs.size();
    for (size_t i = 1; map.is_aligned && i < map.pairs.size(); ++i)
      comparison.path_length += step_length(map, i);
  }
  comparison.maps = std::move(flat.maps);
  if (comparison.matched == 0) {
    return fail(ErrorCode::kDegenerate,
                std::to_string(matches.size()) +
                    " poses match in time, but their positions do not determine an alignment "
                    "(fewer than 3 in a map, or on one line)");
  }
  return comparison;
}

ErrorStatistics summarize(std::vector<double> errors) {
  ErrorStatistics s;
  s.count = errors.size();
  if (errors.empty()) return s;
  std::sort(errors.begin(), errors.end());
  const auto n = static_cast<double>(errors.size());
  double sum = 0;
  double squares = 0;
  for (const double e : errors) {
    sum += e;
    squares += e * e;
  }
  const size_t half = errors.size() / 2;
  s.rmse = std::sqrt(squares / n);
  s.mean = sum / n;
  s.median = errors.size() % 2 == 1 ? errors[half] : 0.5 * (errors[half - 1] + errors[half]);
  s.stddev = std::sqrt(std::max(0.0, squares / n - s.mean * s.mean));
  s.min = errors.front();
  s.max = errors.back();
  return s;
}

AbsoluteError absolute_error(const Comparison& comparison) {
  AbsoluteError result;
  for (const auto& map : comparison.maps) {
    if (!map.is_aligned) continue;
    for (const auto& pair : map.pairs) result.errors.push_back({pair.time, pair_error(map, pair)});
  }
  std::stable_sort(result.errors.begin(), result.errors.end(),
                   [](const TimedError& a, const TimedError& b) { return a.time < b.time; });
  std::vector<double> values;
  for (const auto& error : result.errors) values.push_back(error.value);
  result.translation = summarize(std::move(values));
  return result;
}

Result<RelativeError> relative_error(const Comparison& comparison, double delta, DeltaUnit unit) {
  RelativeError result;
  std::vector<double> translations;
  std::vector<double> rotations;
  for (const auto& map : comparison.maps) {
    if (!map.is_aligned) continue;
    const auto at = stations(map, unit);
    for (size_t i = 0; i + 1 < map.pairs.size(); ++i) {
      const size_t j = partner(at, i, delta);
      if (j == 0) continue;
      const SE3 truth_step = map.pairs[i].truth_from_camera.inverse() * map.pairs[j].truth_from_camera;
      const SE3 map_step = map.pairs[i].map_from_camera.inverse() * map.pairs[j].map_from_camera;
      const SE3 scaled_step(map_step.rotation(), map.truth_from_map.scale() * map_step.translation());
      const SE3 error = truth_step.inverse() * scaled_step;
      translations.push_back(error.translation().norm());
      rotations.push_back(so3_log(error.rotation()).norm());
      result.errors.push_back({map.pairs[j].time, translations.back()});
    }
  }
  if (translations.empty()) {
    return fail(ErrorCode::kDegenerate, "no two matched poses lie the given --delta apart (within 10 %)");
  }
  std::stable_sort(result.errors.begin(), result.errors.end(),
                   [](const TimedError& a, const TimedError& b) { return a.time < b.time; });
  result.translation = summarize(std::move(translations));
  result.rotation = summarize(std::move(rotations));
  return result;
}

}  // namespace cairn
