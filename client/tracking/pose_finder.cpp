// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/pose_finder.h"

#include <algorithm>
#include <utility>

#include "client/tracking/tracker_options.h"
#include "common/geometry/scene_depth.h"

namespace cairn {
namespace {

void find_corners(const FrameImages& frame, int from_level, StageProbe* probe) {
  const ScopedStage stage(probe, Stage::kCorners);
  for (int level = from_level; level < kPyramidLevels; ++level) (void)frame.corners(level);
}

}  // namespace

SearchEffort normal_effort(const TrackerOptions& options) {
  SearchEffort effort;
  const PoseFinderOptions& finder = options.finder;
  effort.coarse_points = finder.coarse_points;
  effort.coarse_radius = finder.coarse_radius;
  effort.fine_radius = finder.fine_radius;
  effort.fine_radius_after_coarse = finder.fine_radius_after_coarse;
  effort.max_squared_cutoff = finder.max_squared_cutoff;
  effort.enough_aligned = finder.enough_aligned;
  effort.doubts_coarse = true;
  return effort;
}

SearchEffort wide_effort(const TrackerOptions& options) {
  SearchEffort effort;
  const PoseFinderOptions& finder = options.finder;
  effort.coarse_points = static_cast<int>(finder.widen * static_cast<float>(finder.coarse_points));
  effort.coarse_radius = finder.widen * finder.coarse_radius;
  effort.fine_radius = finder.widen * finder.fine_radius;
  effort.fine_radius_after_coarse = finder.fine_radius;
  return effort;
}

PoseFinder::PoseFinder(CameraPtr camera, const TrackerOptions& options)
    : camera_(camera),
      options_(options.finder),
      good_quality_(options.good_quality),
      lost_quality_(options.lost_quality),
      search_(std::move(camera), options_.points),
      order_(camera_->width(), camera_->height()) {}

void PoseFinder::clear() {
  std::vector<VisiblePoint> points = std::move(seen_.points);
  points.clear();
  seen_ = Seen{};
  seen_.points = std::move(points);
}

float PoseFinder::quality() const {
  const int in_sight = seen_.attempted - seen_.hidden;
  return in_sight == 0 ? 0 : static_cast<float>(seen_.found) / static_cast<float>(in_sight);
}

void PoseFinder::collect_depths() {
  depths_.clear();
  for (const VisiblePoint& p : seen_.points) {
    if (p.found) depths_.push_back(p.depth);
  }
}

std::optional<double> PoseFinder::near_depth() {
  depths_.clear();
  for (const VisiblePoint& p : seen_.points) depths_.push_back(p.depth);
  if (depths_.empty()) return std::nullopt;
  const auto tenth = depths_.begin() + static_cast<ptrdiff_t>(depths_.size() / 10);
  std::nth_element(depths_.begin(), tenth, depths_.end());
  return *tenth;
}

std::optional<double> PoseFinder::mean_depth() {
  collect_depths();
  if (depths_.empty()) return std::nullopt;
  return scene_depth(&depths_);
}

std::optional<SE3> PoseFinder::solve(const SE3& start, double max_squared_cutoff, StageProbe* probe) {
  const ScopedStage stage(probe, Stage::kPose);
  observations_.clear();
  observed_.clear();
  for (size_t i = 0; i < seen_.points.size(); ++i) {
    const VisiblePoint& p = seen_.points[i];
    if (!p.found) continue;
    observations_.push_back({p.position, p.pixel.cast<double>(), static_cast<double>(1 << p.level)});
    observed_.push_back(i);
  }
  PoseOptions pose_options;
  pose_options.min_squared_cutoff = options_.min_squared_cutoff;
  pose_options.max_squared_cutoff = max_squared_cutoff;
  if (!optimize_pose(*camera_, start, observations_, pose_options, &workspace_, &estimate_))
    return std::nullopt;
  seen_.found = estimate_.inliers;
  seen_.rms = estimate_.rms;
  seen_.covariance = estimate_.covariance;
  // Only what agrees with the pose counts as found.
  for (size_t i = 0; i < observed_.size(); ++i) seen_.points[observed_[i]].found = estimate_.weights[i] > 0;
  return estimate_.camera_from_map;
}

std::optional<SE3> PoseFinder::coarse_stage(const FrameImages& frame, const SE3& start,
                                            const SearchEffort& effort, StageProbe* probe) {
  const auto coarse_end =
      std::find_if(seen_.points.begin(), seen_.points.end(),
                   [this](const VisiblePoint& p) { return p.level < options_.coarse_level; });
  if (coarse_end - seen_.points.begin() < options_.coarse_available) return std::nullopt;
  find_corners(frame, options_.coarse_level, probe);
  int found = 0;
  {
    const ScopedStage stage(probe, Stage::kCoarse);
    const auto count = std::min<ptrdiff_t>(coarse_end - seen_.points.begin(), effort.coarse_points);
    for (auto p = seen_.points.begin(); p != seen_.points.begin() + count; ++p) {
      search_.search(frame, {effort.coarse_radius, options_.refine_iterations, SearchBy::kBoth}, &*p);
      found += p->found ? 1 : 0;
    }
  }
  if (found < options_.coarse_found) return std::nullopt;
  auto pose = solve(start, effort.max_squared_cutoff, probe);
  if (!pose || seen_.found < options_.coarse_found) return std::nullopt;
  return pose;
}

void PoseFinder::search_missing(const FrameImages& frame, const SearchReach& reach, StageProbe* probe) {
  const ScopedStage stage(probe, Stage::kFine);
  for (VisiblePoint& p : seen_.points) {
    if (!p.found) search_.search(frame, reach, &p);
  }
}

std::optional<SE3> PoseFinder::fine_stage(const FrameImages& frame, const SE3& start,
                                          const SearchEffort& effort, float radius, StageProbe* probe) {
  {
    const ScopedStage stage(probe, Stage::kFine);
    std::erase_if(seen_.points, [&](VisiblePoint& p) { return !p.found && !search_.reproject(start, &p); });
  }
  // A coarse point that was not found is looked for again where the coarse pose puts it.
  search_missing(frame, {radius, options_.refine_iterations, SearchBy::kAlignment}, probe);
  const auto is_found = [](const VisiblePoint& p) { return p.found; };
  const auto found = std::count_if(seen_.points.begin(), seen_.points.end(), is_found);
  if (static_cast<float>(found) < effort.enough_aligned * static_cast<float>(seen_.points.size())) {
    find_corners(frame, 0, probe);
    search_missing(frame, {radius, options_.refine_iterations, SearchBy::kCorners}, probe);
  }
  const auto pose = solve(start, effort.max_squared_cutoff, probe);
  return seen_.rms <= options_.most_rms ? pose : std::nullopt;
}

std::optional<SE3> PoseFinder::locate(const FrameImages& frame, const SE3& start, const SearchEffort& effort,
                                      StageProbe* probe) {
  look(frame, start, effort, probe);
  if (effort.doubts_coarse && seen_.used_coarse && !is_as_expected(effort)) {
    SearchEffort without = effort;
    without.coarse_points = 0;
    std::swap(seen_, other_);
    look(frame, start, without, probe);
    if (seen_.found < other_.found) std::swap(seen_, other_);
  }
  return seen_.camera_from_map;
}

bool PoseFinder::is_as_expected(const SearchEffort& effort) const {
  return seen_.camera_from_map && judge() == PoseVerdict::kGood &&
         quality() >= options_.least_of_quality_expected * effort.expected_quality;
}

void PoseFinder::look(const FrameImages& frame, const SE3& start, const SearchEffort& effort,
                      StageProbe* probe) {
  clear();
  {
    const ScopedStage stage(probe, Stage::kProject);
    search_.find_visible(start, options_.max_points, &seen_.points);
  }
  const auto coarse = coarse_stage(frame, start, effort, probe);
  seen_.used_coarse = coarse.has_value();
  if (!coarse) {
    forget_found();
    if (effort.needs_coarse) return;
  }
  seen_.camera_from_map = fine_stage(frame, coarse.value_or(start), effort,
                                     coarse ? effort.fine_radius_after_coarse : effort.fine_radius, probe);
  seen_.attempted = static_cast<int>(seen_.points.size());
  if (!seen_.camera_from_map) forget_found();
  mark_hidden();
}

/// Marks all points as not found: where no pose is believed, nothing agrees with it.
void PoseFinder::forget_found() {
  for (VisiblePoint& p : seen_.points) p.found = false;
  seen_.found = 0;
  seen_.rms = 0;
}

/// Marks points that are hidden by nearer ones. PTAM lacks this, and its quality collapses in maps of more
/// than one side of things.
void PoseFinder::mark_hidden() {
  order_.clear();
  for (const VisiblePoint& p : seen_.points) {
    if (p.found) order_.add(p.expected, p.depth);
  }
  seen_.hidden = 0;
  for (VisiblePoint& p : seen_.points) {
    p.hidden = !p.found && order_.is_hidden(p.expected, p.depth, options_.behind);
    seen_.hidden += p.hidden ? 1 : 0;
  }
}

PoseVerdict PoseFinder::judge() const {
  if (seen_.found < options_.fewest_found) return PoseVerdict::kBad;
  if (quality() > good_quality_) return PoseVerdict::kGood;
  if (quality() < options_.least_quality) return PoseVerdict::kBad;
  int large = 0;
  int large_found = 0;
  for (const VisiblePoint& p : seen_.points) {
    if (p.level < options_.coarse_level || p.hidden) continue;
    ++large;
    large_found += p.found ? 1 : 0;
  }
  const float share = large > options_.large_attempted
                          ? static_cast<float>(large_found) / static_cast<float>(large)
                          : quality();
  return share < lost_quality_ ? PoseVerdict::kBad : PoseVerdict::kPoor;
}

}  // namespace cairn
