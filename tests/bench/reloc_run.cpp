// SPDX-License-Identifier: Apache-2.0
//
// Maps the first frames of a recording with the engines, in one process without DDS, and then asks the
// relocalizer where each of a list of later frames was taken: one question each, from scratch.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/tracking/frame_images.h"
#include "client/tracking/tracker.h"
#include "common/geometry/alignment.h"
#include "common/io/calibration.h"
#include "common/io/trajectory.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {
namespace {

constexpr double kTruthTolerance = 0.012;  // [s] between a frame and its row of truth

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

struct Arguments {
  std::string source, calibration, queries, sequence, truth;
  std::string method = "improved";
  size_t map_frames = 0;
  double tolerance = 0.05;
  uint64_t seed = 1;
  bool verbose = false;
};

/// Builds a map as cairn-engine-run does.
class Mapping {
 public:
  Mapping(CameraPtr camera, uint64_t seed) : camera_(std::move(camera)) {
    tracker_options_.seed = seed;
    maker_options_.seed = seed;
    tracker_ = std::make_unique<Tracker>(camera_, tracker_options_);
  }

  void frame(const Frame& frame) {
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

  [[nodiscard]] const MapMaker* maker() const { return maker_.get(); }
  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  [[nodiscard]] const std::vector<StampedPose>& live() const { return live_; }

 private:
  void seed(const SeedProposal& p) {
    SeedInput input{{},
                    "map-1",
                    Epoch{1},
                    camera_,
                    p.first_time,
                    p.second_time,
                    p.first_image,
                    p.second_image,
                    p.trails,
                    p.second_from_first};
    input.map.bytes[0] = 1;
    auto started = MapMaker::start(input, maker_options_);
    if (!started) return tracker_->seed_refused(started.error().message);
    maker_ = std::move(started->first);
    work();
    tracker_->seed_accepted({snapshot_->map, snapshot_->epoch, snapshot_->revision,
                             started->second.second_keyframe, started->second.points});
  }

  void work() {
    for (;;) {
      if (maker_->step([] { return false; }).work != MapWork::kNone) continue;
      if (!maker_->wants_global_adjustment()) break;
      const auto problem = maker_->prepare_global_adjustment();
      solve(problem.get(), [] { return false; });
      static_cast<void>(maker_->adopt(*problem));
    }
    snapshot_ = maker_->snapshot();
  }

  CameraPtr camera_;
  TrackerOptions tracker_options_;
  MapMakerOptions maker_options_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<MapMaker> maker_;
  MapSnapshotPtr snapshot_;
  std::vector<StampedPose> live_;
};

/// Exact poses by time.
class Truth {
 public:
  explicit Truth(const Trajectory& trajectory) {
    for (const auto& segment : trajectory.segments) {
      for (const StampedPose& p : segment.poses) poses_[p.time] = p.map_from_camera;
    }
  }
  [[nodiscard]] const SE3* at(Timestamp time) const {
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

 private:
  std::map<Timestamp, SE3> poses_;
};

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

/// Frame index -> whether a mapped view is near.
Result<std::map<uint64_t, bool>> read_queries(const Arguments& arguments) {
  std::ifstream file(arguments.queries);
  if (!file) return fail(ErrorCode::kNotFound, arguments.queries + ": cannot be read");
  std::map<uint64_t, bool> queries;
  for (std::string line; std::getline(file, line);) {
    std::istringstream row(line);
    std::string name;
    uint64_t index = 0;
    double time = 0;
    int in_view = 0;
    if (row >> name >> index >> time >> in_view && name == arguments.sequence) queries[index] = in_view != 0;
  }
  return queries;
}

struct Tally {
  int asked = 0, answered = 0, right = 0, wrong = 0, proven_right = 0, proven_wrong = 0;
};

class Judge {
 public:
  Judge(const Arguments& arguments, const Truth& truth, const Similarity3& truth_from_map)
      : arguments_(arguments), truth_(truth), truth_from_map_(truth_from_map) {}

  void judge(const Frame& frame, bool in_view, const MapSnapshot& map, const PlaceAnswer& result) {
    Tally& tally = in_view ? in_view_ : elsewhere_;
    ++tally.asked;
    const PlaceCandidate* best = result.candidates.empty() ? nullptr : &result.candidates.front();
    std::string said = "-";
    if (result.verdict != PlaceVerdict::kNotKnown) {
      ++tally.answered;
      const SE3 estimate = best->camera_from_keyframe * map.find(best->keyframe)->camera_from_map;
      if (const auto off = compare(frame.time, estimate)) {
        ++(is_right(*off) ? tally.right : tally.wrong);
        said = text(*off);
      } else {
        said = "no truth";
      }
    }
    if (!arguments_.verbose) return;
    std::printf("%5lu %d %-11s %s", static_cast<unsigned long>(frame.index), in_view,
                to_string(result.verdict), said.c_str());
    if (best != nullptr) {
      std::printf("  tried %zu tiny %.3f matches %d inliers %d of %d %s", result.candidates.size(),
                  static_cast<double>(best->score), best->matches, best->inliers, best->expected,
                  best->reason.c_str());
    }
    std::printf("\n");
  }

  /// The tracker's own pose some frames after the question; nothing: it believed none. False: no truth here.
  [[nodiscard]] bool judge_proof(const Frame& frame, bool in_view, const std::optional<SE3>& pose) {
    if (truth_.at(frame.time) == nullptr) return false;
    Tally& tally = in_view ? in_view_ : elsewhere_;
    if (!pose) return true;
    const auto off = compare(frame.time, *pose);
    ++(is_right(*off) ? tally.proven_right : tally.proven_wrong);
    if (arguments_.verbose) {
      std::printf("%5lu   tracker: %s\n", static_cast<unsigned long>(frame.index), text(*off).c_str());
    }
    return true;
  }

  void report() const {
    const auto row = [&](const char* what, const Tally& t) {
      std::printf("%s %-10s asked %d answered %d right %d wrong %d; tracker right %d wrong %d\n",
                  arguments_.sequence.c_str(), what, t.asked, t.answered, t.right, t.wrong, t.proven_right,
                  t.proven_wrong);
    };
    row("in view", in_view_);
    row("elsewhere", elsewhere_);
  }

 private:
  struct Offset {
    double metres = 0;
    double degrees = 0;
  };
  [[nodiscard]] std::optional<Offset> compare(Timestamp time, const SE3& camera_from_map) const {
    const SE3* exact = truth_.at(time);
    if (exact == nullptr) return std::nullopt;
    const SE3 found = truth_from_map_.transform_camera(camera_from_map);
    return Offset{(found.center() - exact->translation()).norm(),
                  so3_log((found * *exact).rotation()).norm() * 180 / M_PI};
  }
  [[nodiscard]] bool is_right(const Offset& off) const {
    return off.metres <= arguments_.tolerance && off.degrees <= 5;
  }
  [[nodiscard]] std::string text(const Offset& off) const {
    return fmt::format("{} {:.1f} mm {:.2f} deg", is_right(off) ? "right" : "WRONG", off.metres * 1e3,
                       off.degrees);
  }

  const Arguments& arguments_;
  const Truth& truth_;
  Similarity3 truth_from_map_;
  Tally in_view_, elsewhere_;
};

Result<CameraPtr> choose_camera(const Arguments& arguments) {
  if (!arguments.calibration.empty()) return read_calibration(arguments.calibration).and_then(make_camera);
  if (const auto file = find_calibration(arguments.source))
    return read_calibration(*file).and_then(make_camera);
  return fail(ErrorCode::kConfiguration,
              arguments.source + ": no camera.txt beside it; pass --calibration FILE");
}

/// A tracker that is told of a place and nothing else, and has some frames to prove it.
struct Proof {
  std::unique_ptr<Tracker> tracker;
  uint64_t asked = 0;
  bool in_view = false;
};
constexpr uint64_t kProofFrames = 3;  // as the peers were judged

/// Asks for the listed frames among those that are left in the source.
void ask(FrameSource* source, const std::map<uint64_t, bool>& queries, const CameraPtr& camera,
         const Mapping& mapping, const RelocOptions& options, Judge* judge) {
  PlaceIndex index;
  const double before = thread_cpu_ms();
  index.put(index_map(nullptr, mapping.snapshot(), mapping.maker()->keyframe_views()));
  const double index_ms = thread_cpu_ms() - before;
  std::vector<double> describe_ms;
  std::vector<double> query_ms;
  Proof proof;
  TrackerOptions told;
  told.make_maps = false;
  told.make_keyframes = false;
  for (;;) {
    auto next = source->next();
    if (!next) continue;
    if (!*next) break;
    const Frame& frame = **next;
    if (proof.tracker) {
      const FrameResult& tracked = proof.tracker->track(frame.image, frame.time, mapping.snapshot());
      const auto pose = tracked.pose_measured ? std::optional(tracked.camera_from_map) : std::nullopt;
      if (frame.index - proof.asked >= kProofFrames && judge->judge_proof(frame, proof.in_view, pose)) {
        proof.tracker.reset();
      }
    }
    const auto query = queries.find(frame.index);
    if (query == queries.end()) continue;
    FrameImages images;
    images.build_pyramid(frame.image->view());
    images.find_corners();
    const double begin = thread_cpu_ms();
    const PlaceView view = describe_place(images.pyramid, images.corners);
    const double described = thread_cpu_ms();
    const PlaceAnswer result = relocalize(index, *camera, view, options);
    describe_ms.push_back(described - begin);
    query_ms.push_back(thread_cpu_ms() - described);
    judge->judge(frame, query->second, *mapping.snapshot(), result);
    if (result.verdict == PlaceVerdict::kNotKnown) continue;
    const PlaceCandidate& best = result.candidates.front();
    proof = {std::make_unique<Tracker>(camera, told), frame.index, query->second};
    proof.tracker->place_answered(
        PoseSuggestion{best.map, best.epoch, best.keyframe, best.camera_from_keyframe});
  }
  std::printf("keyframes %zu, indexed in %.1f ms; describing p50 %.2f ms; answer p50 %.2f p95 %.2f ms\n",
              index.keyframe_count(), index_ms, percentile(describe_ms, 0.5), percentile(query_ms, 0.5),
              percentile(query_ms, 0.95));
}

Status run(const Arguments& arguments) {
  auto source = open_source(arguments.source);
  if (!source) return tl::unexpected(source.error());
  auto camera = choose_camera(arguments);
  if (!camera) return tl::unexpected(camera.error());
  const auto queries = read_queries(arguments);
  if (!queries) return tl::unexpected(queries.error());
  const auto exact = read_trajectory(arguments.truth);
  if (!exact) return tl::unexpected(exact.error());
  const Truth truth(*exact);

  Mapping mapping(*camera, arguments.seed);
  for (size_t i = 0; i < arguments.map_frames; ++i) {
    auto next = (*source)->next();
    if (next && !*next) break;
    if (next) mapping.frame(**next);
  }
  if (mapping.maker() == nullptr) return fail(ErrorCode::kDegenerate, "no map came of the first frames");
  const auto truth_from_map = align(mapping.live(), truth);
  if (!truth_from_map) return tl::unexpected(truth_from_map.error());
  RelocOptions options;
  options.method = arguments.method == "paper" ? RelocMethod::kPaper : RelocMethod::kImproved;
  Judge judge(arguments, truth, *truth_from_map);
  ask(source->get(), *queries, *camera, mapping, options, &judge);
  judge.report();
  return {};
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Map from the first frames, then single relocalizations, without DDS");
  cairn::Arguments arguments;
  app.add_option("--source", arguments.source, "tum:DIR, video:FILE?times=FILE, ...")->required();
  app.add_option("--calibration", arguments.calibration, "camera file; default: beside the source");
  app.add_option("--queries", arguments.queries, "rows `sequence frame time in_view`")->required();
  app.add_option("--sequence", arguments.sequence, "rows of the queries file to ask")->required();
  app.add_option("--truth", arguments.truth, "TUM trajectory")->required();
  app.add_option("--map-frames", arguments.map_frames, "frames that the map is made of")->required();
  app.add_option("--tolerance", arguments.tolerance, "[m] of a right answer");
  app.add_option("--method", arguments.method, "improved or paper")
      ->check(CLI::IsMember({"improved", "paper"}));
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per query");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    std::fprintf(stderr, "cairn-reloc-run: %s\n", done.error().message.c_str());
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
