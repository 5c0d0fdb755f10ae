// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/recorded_map.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

#include "common/io/calibration.h"

namespace cairn {
namespace {

constexpr double kTruthTolerance = 0.012;  // [s] between a frame and its row of truth

}  // namespace

double thread_cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

double percentile(std::vector<double> values, double p) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(p * static_cast<double>(values.size() - 1))];
}

Result<CameraPtr> choose_camera(const std::string& source, const std::string& file) {
  if (!file.empty()) return read_calibration(file).and_then(make_camera);
  if (const auto found = find_calibration(source)) return read_calibration(*found).and_then(make_camera);
  return fail(ErrorCode::kConfiguration, source + ": no camera.txt beside it; pass --calibration FILE");
}

Mapping::Mapping(CameraPtr camera, MapId map, uint64_t seed) : camera_(std::move(camera)), map_(map) {
  tracker_options_.seed = seed;
  maker_options_.seed = seed;
  tracker_ = std::make_unique<Tracker>(camera_, tracker_options_);
}

void Mapping::frame(const Frame& frame) {
  const FrameResult& result = tracker_->track(frame.image, frame.time, snapshot_);
  if (result.pose_measured) live_.push_back({frame.time, result.camera_from_map.inverse()});
  if (result.place_question) tracker_->place_answered(std::nullopt);
  if (result.seed) seed(*result.seed);
  if (!result.keyframe) return;
  const KeyframeProposal& k = *result.keyframe;
  const auto decision = maker_->add_keyframe(
      {camera_, frame.time, frame.image, k.reference, k.camera_from_reference, k.measurements});
  if (decision.verdict == KeyframeVerdict::kAccepted) work();
}

void Mapping::seed(const SeedProposal& p) {
  SeedInput input{map_,          "map-1",       Epoch{1},       camera_,  p.first_time,
                  p.second_time, p.first_image, p.second_image, p.trails, p.second_from_first};
  auto started = MapMaker::start(input, maker_options_);
  if (!started) return tracker_->seed_refused(started.error().message);
  maker_ = std::move(started->first);
  work();
  tracker_->seed_accepted({snapshot_->map, snapshot_->epoch, snapshot_->revision,
                           started->second.second_keyframe, started->second.points});
}

void Mapping::work() {
  for (;;) {
    if (maker_->step([] { return false; }).work != MapWork::kNone) continue;
    if (!maker_->wants_global_adjustment()) break;
    const auto problem = maker_->prepare_global_adjustment();
    solve(problem.get(), [] { return false; });
    static_cast<void>(maker_->adopt(*problem));
  }
  snapshot_ = maker_->snapshot();
}

Result<IndexedMapPtr> map_beginning(FrameSource* source, size_t frames, Mapping* mapping) {
  for (size_t i = 0; i < frames; ++i) {
    auto next = source->next();
    if (next && !*next) break;
    if (next) mapping->frame(**next);
  }
  if (mapping->maker() == nullptr) return fail(ErrorCode::kDegenerate, "no map came of the first frames");
  return index_map(nullptr, mapping->snapshot(), mapping->maker()->keyframe_views());
}

Status map_others(const std::vector<std::string>& sources, uint8_t first, uint64_t seed, PlaceIndex* index) {
  MapId id;
  id.bytes[0] = first;
  for (const std::string& uri : sources) {
    auto source = open_source(uri);
    if (!source) return tl::unexpected(source.error());
    const auto known = (*source)->builtin_calibration();
    const auto camera = known ? make_camera(*known) : choose_camera(uri, "");
    if (!camera) return tl::unexpected(camera.error());
    Mapping mapping(*camera, id, seed);
    auto map = map_beginning(source->get(), std::numeric_limits<size_t>::max(), &mapping);
    if (!map) return fail(map.error().code, uri + ": " + map.error().message);
    index->put(std::move(*map));
    ++id.bytes[0];
  }
  return {};
}

Truth::Truth(const Trajectory& trajectory) {
  for (const auto& segment : trajectory.segments) {
    for (const StampedPose& p : segment.poses) poses_[p.time] = p.map_from_camera;
  }
}

const SE3* Truth::at(Timestamp time) const {
  const SE3* best = nullptr;
  double nearest = kTruthTolerance;
  auto it = poses_.lower_bound(time);
  if (it != poses_.begin()) --it;
  for (int i = 0; i < 2 && it != poses_.end(); ++i, ++it) {
    const double off = std::abs(seconds_between(it->first, time));
    if (off > nearest) continue;
    nearest = off;
    best = &it->second;
  }
  return best;
}

Result<Similarity3> align(const std::vector<StampedPose>& live, const Truth& truth) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const StampedPose& p : live) {
    const SE3* exact = truth.at(p.time);
    if (exact == nullptr) continue;
    from.push_back(p.map_from_camera.translation());
    to.push_back(exact->translation());
  }
  return align_points(from, to, true);
}

Offset compare(const Similarity3& truth_from_map, const SE3& camera_from_map, const SE3& exact) {
  const SE3 found = truth_from_map.transform_camera(camera_from_map);
  return {(found.center() - exact.translation()).norm(),
          so3_log((found * exact).rotation()).norm() * 180 / M_PI};
}

}  // namespace cairn
