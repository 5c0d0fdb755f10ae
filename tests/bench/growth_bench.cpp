// SPDX-License-Identifier: Apache-2.0
//
// What a frame costs the tracker as the map grows. A map is made of a recording by the engines until it has
// so many points; larger ones are that map with whole copies of itself put elsewhere: behind what the camera
// looks at, and beside it. So what is added has the statistics of real points, patches and observers
// included. The frames of the place are then tracked in each map, from the relocalizer's answer on.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/tracking/tracker.h"
#include "common/base/log.h"
#include "server/relocalization/relocalizer.h"
#include "tests/bench/json_file.h"
#include "tests/bench/mapping_loop.h"
#include "tests/bench/recorded_map.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

struct Arguments {
  std::string source;
  std::string calibration;
  std::string json;
  std::vector<size_t> points = {3000, 10'000, 30'000, 100'000};
  size_t frames = 300;
  int rounds = 3;
  uint64_t seed = 1;
};

// ---- maps of any size ----

/// Extent of a map, and the direction in which those who made it looked.
struct Extent {
  Eigen::Vector3d looking;  ///< unit
  double radius;            ///< about their middle, nine points in ten [map unit]
};

Extent extent_of(const MapSnapshot& map) {
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& block : map.point_blocks) {
    for (int s = 0; s < block->count; ++s) {
      if ((block->live >> s & 1) == 0) continue;
      points.push_back(block->position(s));
      middle += points.back();
    }
  }
  middle /= static_cast<double>(points.size());
  std::vector<double> distances;
  distances.reserve(points.size());
  for (const Eigen::Vector3d& p : points) distances.push_back((p - middle).norm());
  Eigen::Vector3d looking = Eigen::Vector3d::Zero();
  for (const auto& block : map.keyframe_blocks) {
    for (size_t s = 0; s < block->keyframes.size(); ++s) {
      if ((block->live >> s & 1) != 0)
        looking += block->keyframes[s].camera_from_map.rotation().conjugate() * Eigen::Vector3d::UnitZ();
    }
  }
  return {looking.normalized(), percentile(distances, 0.9)};
}

/// Pose of the n-th copy, from 1 on, against the map: every other one behind it, the others around the line
/// of sight, turned.
SE3 place_of_copy(const Extent& extent, int n) {
  const double far = extent.radius * (1.5 + 0.5 * n);
  if (n % 2 == 1) return {Eigen::Quaterniond::Identity(), far * extent.looking};
  const double turn = n * std::numbers::phi * 2 * std::numbers::pi;  // never twice the same
  const Eigen::Quaterniond around = so3_exp(turn * extent.looking);
  const Eigen::Vector3d beside = extent.looking.unitOrthogonal();
  return {so3_exp(turn * Eigen::Vector3d::UnitZ()), far * (around * beside)};
}

template <typename Id>
Id shifted(Id id, uint64_t by) {
  return Id{id.value + by};
}

KeyframeBlock copy_keyframes(const KeyframeBlock& from, const SE3& place, uint64_t shift) {
  KeyframeBlock block = from;
  for (KeyframePose& k : block.keyframes) {
    k.id = shifted(k.id, shift);
    k.camera_from_map = k.camera_from_map * place.inverse();
  }
  return block;
}

std::shared_ptr<const PointBlock> copy_points(
    const PointBlock& from, const SE3& place, uint64_t shift,
    const std::vector<std::shared_ptr<const KeyframeBlock>>& keyframes) {
  auto patches = std::make_shared<PatchBlock>(*from.patches);
  for (PointSource& source : patches->points) {
    source.id = shifted(source.id, shift);
    source.keyframe = shifted(source.keyframe, shift);
  }
  auto positions = std::make_shared<PositionBlock>(*from.positions);
  for (Eigen::Vector3f& p : positions->positions) p = (place * p.cast<double>()).cast<float>();
  for (PointVisibility& v : positions->visibility)
    v.mean_direction = place.rotation().cast<float>() * v.mean_direction;
  return make_point_block(std::move(patches), std::move(positions), keyframes);
}

/// The map with as many copies as give it so many points.
MapSnapshotPtr grow(const MapSnapshot& map, size_t points) {
  constexpr uint64_t kShift = uint64_t{1} << 32;  // of the ids of one copy against those before
  const Extent extent = extent_of(map);
  auto grown = std::make_shared<MapSnapshot>(map);
  const size_t in_one = map.point_count();
  for (int n = 1; static_cast<size_t>(n) * in_one < points; ++n) {
    const SE3 place = place_of_copy(extent, n);
    const uint64_t shift = kShift * static_cast<uint64_t>(n);
    for (const auto& block : map.keyframe_blocks)
      grown->keyframe_blocks.push_back(
          std::make_shared<const KeyframeBlock>(copy_keyframes(*block, place, shift)));
    for (const auto& block : map.point_blocks)
      grown->point_blocks.push_back(copy_points(*block, place, shift, grown->keyframe_blocks));
  }
  return grown;
}

// ---- tracking in them ----

/// A recorded place: the map that its frames made, and the last of them.
struct Place {
  CameraPtr camera;
  MapSnapshotPtr map;
  IndexedMapPtr indexed;
  std::vector<Frame> frames;
};

Result<Place> record(const Arguments& arguments) {
  auto source = open_aloud(arguments.source);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(**source, arguments.source, arguments.calibration);
  if (!camera) return tl::unexpected(camera.error());
  MappingOptions options;
  options.map.bytes[0] = 1;
  options.seed = arguments.seed;
  MappingLoop mapping(*camera, options);
  std::vector<Frame> frames;
  const size_t wanted = arguments.points.front();
  while (!mapping.snapshot() || mapping.snapshot()->point_count() < wanted) {
    auto next = (*source)->next();
    if (!next) continue;
    if (!*next) break;
    mapping.frame(**next);
    if (mapping.snapshot()) frames.push_back(**next);
  }
  if (!mapping.snapshot()) return fail(ErrorCode::kDegenerate, arguments.source + ": no map came of it");
  if (frames.size() > arguments.frames)
    frames.erase(frames.begin(), frames.end() - static_cast<std::ptrdiff_t>(arguments.frames));
  return Place{*camera, mapping.snapshot(), mapping.indexed(), std::move(frames)};
}

class ProjectProbe final : public StageProbe {
 public:
  void begin(Stage stage) override {
    if (stage == Stage::kProject) began_ = thread_cpu_ms();
  }
  void end(Stage stage) override {
    if (stage == Stage::kProject) ms_ += thread_cpu_ms() - began_;
  }
  /// Takes the processor time [ms] of the projection in a frame; the next one counts from 0.
  [[nodiscard]] double take() { return std::exchange(ms_, 0.0); }

 private:
  double began_ = 0;
  double ms_ = 0;
};

/// One frame of a map in all rounds: times are the least of them, as other jobs only add.
struct FrameCost {
  bool tracked = false;
  double ms = 0;
  double project_ms = 0;
  double attempted = 0;
  double found = 0;
};

void play_once(const Place& place, const MapSnapshotPtr& map, uint64_t seed, std::vector<FrameCost>* costs) {
  TrackerOptions options;
  options.seed = seed;
  Tracker tracker(place.camera, options);
  PlaceIndex index;
  index.put(place.indexed);
  ProjectProbe probe;
  for (size_t i = 0; i < place.frames.size(); ++i) {
    const Frame& frame = place.frames[i];
    const double before = thread_cpu_ms();
    const FrameResult& result = tracker.track(frame.image, frame.time, map, &probe);
    const FrameCost now{result.state == TrackingState::kTracking || result.state == TrackingState::kPoor,
                        thread_cpu_ms() - before, probe.take(), static_cast<double>(result.attempted),
                        static_cast<double>(result.found)};
    FrameCost& cost = (*costs)[i];
    if (!cost.tracked || now.ms < cost.ms) cost = now;
    if (result.reloc_query) {
      const RelocalizationAnswer said = relocalize(index, *place.camera, *result.reloc_query, RelocOptions());
      static_cast<void>(tracker.relocalization_answered(hypothesis_of(said)));
    }
  }
}

/// Prints a row of results, and returns it as JSON.
nlohmann::json print_row(size_t wanted, const MapSnapshot& map, const std::vector<FrameCost>& costs,
                         const std::vector<FrameCost>& in_first) {
  std::vector<double> ms, project, attempted, found, growth;
  for (size_t i = 0; i < costs.size(); ++i) {
    if (!costs[i].tracked || !in_first[i].tracked) continue;
    ms.push_back(costs[i].ms);
    project.push_back(costs[i].project_ms);
    attempted.push_back(costs[i].attempted);
    found.push_back(costs[i].found);
    growth.push_back(costs[i].ms - in_first[i].ms);
  }
  std::printf("%8zu %5zu %5zu/%zu %6.0f %5.0f   %6.3f %6.3f %6.3f   %6.3f %6.3f   %6.3f %6.3f\n",
              map.point_count(), map.keyframe_count(), ms.size(), costs.size(), percentile(attempted, 0.5),
              percentile(found, 0.5), percentile(ms, 0.5), percentile(ms, 0.95), percentile(ms, 0.99),
              percentile(project, 0.5), percentile(project, 0.95), percentile(growth, 0.5),
              percentile(growth, 0.95));
  return {{"wanted", wanted},
          {"points", map.point_count()},
          {"keyframes", map.keyframe_count()},
          {"tracked", ms.size()},
          {"frames", costs.size()},
          {"attempted", spread_json(attempted)},
          {"found", spread_json(found)},
          {"cpu_ms", spread_json(ms)},
          {"project_ms", spread_json(project)},
          {"more_than_in_first_ms", spread_json(growth)}};
}

Status run(const Arguments& arguments) {
  const auto place = record(arguments);
  if (!place) return tl::unexpected(place.error());
  std::vector<MapSnapshotPtr> maps;
  for (const size_t points : arguments.points) maps.push_back(grow(*place->map, points));
  std::vector<std::vector<FrameCost>> costs(maps.size(), std::vector<FrameCost>(place->frames.size()));
  for (int round = 0; round < arguments.rounds; ++round) {
    for (size_t m = 0; m < maps.size(); ++m) play_once(*place, maps[m], arguments.seed, &costs[m]);
  }
  std::printf(
      "  points    kf   tracked  tried found   CPU ms p50   p95    p99   project ms p50  p95   "
      "more than in the first p50, p95\n");
  nlohmann::json figures = nlohmann::json::array();
  for (size_t m = 0; m < maps.size(); ++m)
    figures.push_back(print_row(arguments.points[m], *maps[m], costs[m], costs[0]));
  return write_figures(arguments.json, figures);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("What a frame costs the tracker as the map grows");
  cairn::Arguments arguments;
  app.add_option("--source", arguments.source, "tum:DIR, video:FILE?times=FILE, sim:SCENARIO, ...")
      ->required();
  app.add_option("--calibration", arguments.calibration, "camera file; default: beside the source");
  app.add_option("--points", arguments.points,
                 "of the maps at least; the source is mapped until it has the first");
  app.add_option("--frames", arguments.frames, "the last so many of those mapped are tracked");
  app.add_option("--rounds", arguments.rounds, "of each frame the least time of so many counts");
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_option("--json", arguments.json, "write the figures here, for write-figures")->type_name("FILE");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    cairn::say_error("cairn-growth-bench", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
