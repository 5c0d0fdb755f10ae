// SPDX-License-Identifier: Apache-2.0
//
// Plays a source through tracker and map maker in one process and one thread, without DDS: the engines by
// themselves, every unit of map work finished before the next frame. What a change of an engine does shows
// here first; real runs are tests/bench/run-accuracy's.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <optional>
#include <string_view>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/capture/imu_source.h"
#include "common/base/log.h"
#include "common/geometry/camera_guess.h"
#include "common/io/calibration.h"
#include "common/io/trajectory.h"
#include "server/mapping/adjustment.h"
#include "tests/bench/bundle_file.h"
#include "tests/bench/mapping_loop.h"
#include "tests/bench/recorded_map.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

class CpuProbe final : public StageProbe {
 public:
  void begin(Stage stage) override { started_[static_cast<size_t>(stage)] = thread_cpu_ms(); }
  void end(Stage stage) override {
    frame_[static_cast<size_t>(stage)] += thread_cpu_ms() - started_[static_cast<size_t>(stage)];
  }
  void finish_frame() {
    for (size_t s = 0; s < frame_.size(); ++s) all_[s].push_back(frame_[s]);
    frame_.fill(0);
  }
  [[nodiscard]] const std::vector<double>& stage(size_t s) const { return all_[s]; }

 private:
  static constexpr size_t kStages = static_cast<size_t>(Stage::kCount);
  std::array<double, kStages> started_{};
  std::array<double, kStages> frame_{};
  std::array<std::vector<double>, kStages> all_;
};

struct Arguments {
  std::string source;
  std::string calibration;
  std::string trajectory;
  std::string keyframes;
  uint64_t seed = 1;
  bool ceres = false;
  double start_focal = 1;  ///< factor
  size_t skip = 0;
  std::string bundle;
  size_t frames = SIZE_MAX;
  size_t after_start = SIZE_MAX;
  bool local_only = false;
  std::vector<size_t> hidden;  ///< pairs: frame, count; something passes in front of the camera
  std::vector<double> cut;     ///< [s] from, to: the map maker hears nothing meanwhile
  bool ask = true;             ///< a lost tracker may ask the relocalizer
  bool verbose = false;
};

struct AdjustmentTotals {
  std::vector<double> ms, observations, iterations;

  void add(double took_ms, const StepReport& report) {
    ms.push_back(took_ms);
    observations.push_back(report.observations);
    iterations.push_back(report.iterations);
  }
  void print(const char* name) const {
    std::printf(
        "%s adjustment ms p50 %.1f p95 %.1f; observations p50 %.0f p95 %.0f; iterations p50 %.0f p95 %.0f\n",
        name, percentile(ms, 0.5), percentile(ms, 0.95), percentile(observations, 0.5),
        percentile(observations, 0.95), percentile(iterations, 0.5), percentile(iterations, 0.95));
  }
};

struct Totals {
  size_t frames = 0, with_map = 0, tracked = 0, lost = 0, accepted = 0, refused = 0;
  size_t queries = 0, places = 0;
  long first_map_frame = -1;
  std::vector<double> cpu_ms, attempted, found, seed_ms, keyframe_ms;
  AdjustmentTotals local, global;
};

MappingOptions mapping_options(const Arguments& arguments, std::optional<CameraPrior> prior, ImuStream* imu,
                               StageProbe* probe, MappingObserver* observer) {
  MappingOptions options;
  options.map.bytes[0] = 1;
  options.seed = arguments.seed;
  options.adjuster = arguments.ceres ? Adjuster::kCeres : Adjuster::kOwn;
  options.local_only = arguments.local_only;
  options.prior = std::move(prior);
  options.imu = imu;
  options.ask = arguments.ask;
  if (arguments.cut.size() == 2) {
    options.cut_from = arguments.cut[0];
    options.cut_to = arguments.cut[1];
  }
  options.probe = probe;
  options.observer = observer;
  return options;
}

class EngineRun final : public MappingObserver {
 public:
  /// `imu` may be null.
  EngineRun(const Arguments& arguments, CameraPtr camera, std::optional<CameraPrior> prior, ImuStream* imu,
            TrajectoryWriter* trajectory)
      : arguments_(arguments),
        trajectory_(trajectory),
        mapping_(std::move(camera), mapping_options(arguments, std::move(prior), imu, &probe_, this)) {}
  EngineRun(const EngineRun&) = delete;
  EngineRun& operator=(const EngineRun&) = delete;

  void frame(const Frame& frame) {
    Frame shown = frame;
    if (is_hidden(frame.index)) shown.image = black(*frame.image);
    mapping_.frame(shown);
  }

  /// Keyframes as they are after the run.
  Status write_keyframes(TrajectoryWriter* file) const {
    const MapSnapshotPtr& map = mapping_.snapshot();
    for (const auto& [id, time] : keyframe_times_) {
      const KeyframePose* keyframe = map ? map->find(id) : nullptr;
      if (keyframe == nullptr) continue;
      auto written = file->append(map->map, map->name, {time, keyframe->camera_from_map.inverse()});
      if (!written) return written;
    }
    return {};
  }

  /// Enough frames were tracked with a map.
  [[nodiscard]] bool done() const { return totals_.with_map >= arguments_.after_start; }

  /// The problem of a global adjustment of the map as it is now.
  [[nodiscard]] Status write_global_problem(const std::string& path) const {
    if (mapping_.maker() == nullptr) return fail(ErrorCode::kNotFound, path + ": no map was made");
    return write_bundle(path, mapping_.maker()->prepare_global_adjustment()->problem.bundle);
  }

  void report() const {
    const Totals& t = totals_;
    std::printf("frames %zu first map frame %ld tracked %zu of %zu (%.2f %%) lost %zu\n", t.frames,
                t.first_map_frame, t.tracked, t.with_map,
                100.0 * static_cast<double>(t.tracked) / static_cast<double>(std::max<size_t>(1, t.with_map)),
                t.lost);
    std::printf("tracker cpu ms p50 %.2f p95 %.2f p99 %.2f; attempted p50 %.0f found p50 %.0f\n",
                percentile(t.cpu_ms, 0.5), percentile(t.cpu_ms, 0.95), percentile(t.cpu_ms, 0.99),
                percentile(t.attempted, 0.5), percentile(t.found, 0.5));
    for (size_t s = 0; s < static_cast<size_t>(Stage::kCount); ++s) {
      std::printf("  %-8s p50 %.3f p95 %.3f\n", to_string(static_cast<Stage>(s)),
                  percentile(probe_.stage(s), 0.5), percentile(probe_.stage(s), 0.95));
    }
    std::printf("keyframes accepted %zu refused %zu; keyframe ms p50 %.1f p95 %.1f\n", t.accepted, t.refused,
                percentile(t.keyframe_ms, 0.5), percentile(t.keyframe_ms, 0.95));
    t.local.print("local");
    t.global.print("global");
    std::printf("queries %zu, places found %zu\n", t.queries, t.places);
    for (const auto& [reason, n] : refusals_) std::printf("  refused %zu: %s\n", n, reason.c_str());
    if (const MapMaker* maker = mapping_.maker()) {
      const MapStatistics m = maker->statistics();
      std::printf("map: %zu keyframes %zu points %zu measurements, %.2f MB, reprojection %.3f px\n",
                  m.keyframes, m.points, m.measurements, static_cast<double>(m.bytes) / 1e6,
                  maker->reprojection_rms());
    }
  }

  void on_frame(const Frame& frame, const FrameResult& result, double ms) override {
    totals_.cpu_ms.push_back(ms);
    probe_.finish_frame();
    ++totals_.frames;
    if (mapping_.snapshot()) count(frame, result);
    note_recovery(frame.index, result.pose_measured);
    if (arguments_.verbose) print_frame(frame, result);
  }

  void on_answer(const RelocalizationAnswer& answer) override {
    ++totals_.queries;
    if (answer.verdict == RelocalizationVerdict::kConfirmed) ++totals_.places;
  }

  void on_seed(const Frame& frame, const SeedProposal& proposal, const Result<SeedResult>& started,
               double ms) override {
    if (!started) {
      std::printf("frame %lu: seed refused: %s\n", static_cast<unsigned long>(frame.index),
                  started.error().message.c_str());
      return;
    }
    keyframe_times_ = {{started->first_keyframe, proposal.first_time},
                       {started->second_keyframe, proposal.second_time}};
    totals_.first_map_frame = static_cast<long>(frame.index);
    std::printf("frame %lu: map started, %zu trails of %zu, %.0f ms, plane %d, %zu points\n",
                static_cast<unsigned long>(frame.index), started->points.size(), proposal.trails.size(), ms,
                started->plane_aligned, mapping_.maker()->statistics().points);
    if (arguments_.verbose) print_start(*started, proposal);
  }

  void on_camera(const CameraEstimate& estimate) override {
    const auto& values = estimate.camera->parameters().values;
    std::printf("frame %zu: camera version %u: f %.2f +- %.2f, k1 %.4f +- %.4f%s\n", totals_.frames,
                estimate.version.version, values[0], estimate.sigma[0] * values[0], values[4],
                estimate.sigma[1],
                estimate.frozen            ? ", frozen"
                : estimate.cannot_be_known ? ", cannot be known"
                                           : "");
  }
  void on_keyframe(const Frame& frame, const KeyframeDecision& decision, double ms) override {
    totals_.keyframe_ms.push_back(ms);
    if (arguments_.verbose) print_keyframe(frame, decision);
    if (decision.verdict != KeyframeVerdict::kAccepted) {
      ++totals_.refused;
      ++refusals_[decision.reason.substr(0, 40)];
      return;
    }
    ++totals_.accepted;
    keyframe_times_[decision.keyframe] = frame.time;
  }

  void on_work(const StepReport& report, double ms) override {
    if (report.work == MapWork::kLocalAdjustment) totals_.local.add(ms, report);
    if (report.work == MapWork::kGlobalAdjustment) totals_.global.add(ms, report);
  }

 private:
  void count(const Frame& frame, const FrameResult& result) {
    ++totals_.with_map;
    if (result.state == TrackingState::kLost) ++totals_.lost;
    if (!result.pose_measured) return;
    ++totals_.tracked;
    totals_.attempted.push_back(result.attempted);
    totals_.found.push_back(result.found);
    if (trajectory_ != nullptr) {
      static_cast<void>(trajectory_->append(mapping_.snapshot()->map, mapping_.snapshot()->name,
                                            {frame.time, result.camera_from_map.inverse()}));
    }
  }

  [[nodiscard]] bool is_hidden(size_t index) const {
    for (size_t i = 0; i + 1 < arguments_.hidden.size(); i += 2) {
      if (index >= arguments_.hidden[i] && index - arguments_.hidden[i] < arguments_.hidden[i + 1])
        return true;
    }
    return false;
  }
  static GrayImagePtr black(const GrayImage& like) {
    auto image = std::make_shared<GrayImage>(like.width(), like.height());
    for (int y = 0; y < image->height(); ++y) std::fill_n(image->row(y), image->width(), uint8_t{8});
    return image;
  }

  /// How many frames after the view is free again the first pose comes.
  void note_recovery(size_t index, bool posed) {
    if (is_hidden(index)) {
      free_since_ = index + 1;
    } else if (free_since_ > 0 && posed) {
      std::printf("frame %zu: hidden before, tracked again after %zu frames\n", index,
                  index - free_since_ + 1);
      free_since_ = 0;
    }
  }

  static void print_frame(const Frame& frame, const FrameResult& result) {
    std::printf("%5lu state %d found %d/%d rms %.2f depth %.2f %s\n", static_cast<unsigned long>(frame.index),
                static_cast<int>(result.state), result.found, result.attempted, result.reprojection_rms,
                result.mean_depth, result.note.c_str());
  }

  static void print_keyframe(const Frame& frame, const KeyframeDecision& decision) {
    const bool accepted = decision.verdict == KeyframeVerdict::kAccepted;
    std::printf("frame %lu: keyframe %s\n", static_cast<unsigned long>(frame.index),
                accepted ? "accepted" : ("refused: " + decision.reason).c_str());
  }

  void print_start(const SeedResult& started, const SeedProposal& proposal) const {
    const KeyframePose* first = mapping_.snapshot()->find(started.first_keyframe);
    const KeyframePose* second = mapping_.snapshot()->find(started.second_keyframe);
    if (first == nullptr || second == nullptr) return;
    const SE3 step = second->camera_from_map * first->camera_from_map.inverse();
    const Eigen::Vector3d t = step.translation();
    const Eigen::Vector3d r = so3_log(step.rotation());
    std::printf("start: %.6f %.6f depth %.3f t %.5f %.5f %.5f r %.5f %.5f %.5f\n",
                proposal.first_time.seconds(), proposal.second_time.seconds(),
                static_cast<double>(first->mean_depth), t.x(), t.y(), t.z(), r.x(), r.y(), r.z());
  }

  const Arguments& arguments_;
  TrajectoryWriter* trajectory_;  ///< null: none
  CpuProbe probe_;
  MappingLoop mapping_;
  size_t free_since_ = 0;
  Totals totals_;
  std::map<std::string, size_t> refusals_;
  std::map<KeyframeId, Timestamp> keyframe_times_;
};

constexpr std::string_view kAuto = "auto";
constexpr std::string_view kAutoFrom = "auto:";
constexpr std::string_view kExactly = "exact:";

struct ChosenCamera {
  CameraPtr camera;
  std::optional<CameraPrior> prior;
};

ChosenCamera with_prior(CameraPtr camera, const IntrinsicsPrior& guess) {
  return {std::move(camera), CameraPrior{{{}, 1, 1}, {guess.focal_sigma, guess.k1_sigma}}};
}

/// The camera for `auto`: what is known of a self-calibrated camera at first.
Result<ChosenCamera> choose_uncertain_camera(const Arguments& arguments, const Frame& first) {
  const ImageSize size{first.image->width(), first.image->height()};
  IntrinsicsPrior guess = guess_camera(size);
  if (arguments.calibration != kAuto) {
    const auto rough =
        read_calibration(arguments.calibration.substr(kAutoFrom.size()), size).and_then(rough_prior);
    if (!rough) return tl::unexpected(rough.error());
    guess = *rough;
  }
  for (const size_t i : {0, 1}) guess.parameters.values[i] *= arguments.start_focal;
  const auto camera = make_camera(guess.parameters);
  if (!camera) return tl::unexpected(camera.error());
  return with_prior(*camera, guess);
}

Result<ChosenCamera> choose(const Arguments& arguments, const FrameSource& source, const Frame& first) {
  if (arguments.calibration == kAuto || arguments.calibration.starts_with(kAutoFrom))
    return choose_uncertain_camera(arguments, first);
  const bool is_exact = arguments.calibration.starts_with(kExactly) ||
                        (arguments.calibration.empty() && source.builtin_calibration());
  const std::string file =
      arguments.calibration.substr(arguments.calibration.starts_with(kExactly) ? kExactly.size() : 0);
  const auto camera = choose_camera(source, arguments.source, file);
  if (!camera) return tl::unexpected(camera.error());
  const auto nominal = is_exact ? std::nullopt : nominal_camera((*camera)->parameters());
  if (!nominal) return ChosenCamera{*camera, {}};
  return make_camera(nominal->parameters).map([&](const CameraPtr& same) {
    return with_prior(same, *nominal);
  });
}

Status run(const Arguments& arguments) {
  auto source = open_aloud(arguments.source);
  if (!source) return tl::unexpected(source.error());
  const auto imu = open_imu(arguments.source, **source, {});
  if (!imu) return tl::unexpected(imu.error());
  std::optional<TrajectoryWriter> trajectory;
  if (!arguments.trajectory.empty()) {
    auto opened = TrajectoryWriter::open(arguments.trajectory);
    if (!opened) return tl::unexpected(opened.error());
    trajectory.emplace(std::move(*opened));
  }
  // A camera to be self-calibrated is guessed from the size of the first image.
  std::optional<EngineRun> engine;
  for (size_t i = 0; i < arguments.frames;) {
    auto next = (*source)->next();
    if (!next) {
      std::fprintf(stderr, "%s\n", next.error().message.c_str());
      continue;
    }
    if (!*next) break;
    if (i++ < arguments.skip) continue;
    if (!engine) {
      const auto chosen = choose(arguments, **source, **next);
      if (!chosen) return tl::unexpected(chosen.error());
      engine.emplace(arguments, chosen->camera, chosen->prior, imu->stream.get(),
                     trajectory ? &*trajectory : nullptr);
    }
    engine->frame(**next);
    if (engine->done()) break;
  }
  if (!engine) return fail(ErrorCode::kDamaged, arguments.source + ": no frame could be read");
  engine->report();
  if (!arguments.keyframes.empty()) {
    auto file = TrajectoryWriter::open(arguments.keyframes);
    if (!file) return tl::unexpected(file.error());
    if (const auto written = engine->write_keyframes(&*file); !written) return written;
    if (const auto written = file->finish(); !written) return written;
  }
  if (!arguments.bundle.empty()) return engine->write_global_problem(arguments.bundle);
  return {};
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Tracker and map maker in one process, without DDS");
  cairn::Arguments arguments;
  app.add_option("--source", arguments.source, "tum:DIR, video:FILE?times=FILE, sim:SCENARIO, ...")
      ->required();
  app.add_option("--calibration", arguments.calibration,
                 "as cairn-track's: camera file, auto, auto:FILE or exact:FILE; default: beside the source");
  app.add_option("--start-focal", arguments.start_focal,
                 "with --calibration auto: factor on the focal length that it starts from");
  app.add_option("--trajectory", arguments.trajectory, "TUM rows are written here");
  app.add_option("--keyframes", arguments.keyframes,
                 "TUM rows of the keyframes after the run are written here");
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_option("--skip", arguments.skip, "frames passed over at the start");
  app.add_option("--frames", arguments.frames, "frames read at most");
  app.add_option("--after-start", arguments.after_start, "frames tracked at most once there is a map");
  app.add_flag("--local-only", arguments.local_only, "no global adjustment");
  app.add_option("--bundle", arguments.bundle,
                 "the last map's global adjustment is written here, for cairn-ba-bench");
  app.add_flag("--ceres", arguments.ceres, "bundle adjustment by Ceres");
  app.add_option("--hide", arguments.hidden, "frame and count, and so on: the camera sees nothing there");
  app.add_option(
         "--cut", arguments.cut,
         "seconds of the recording: from the first on the map maker hears nothing, and at the second all "
         "of it in order")
      ->expected(2);
  app.add_flag("!--alone", arguments.ask, "a lost tracker asks nobody");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per frame");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    cairn::say_error("cairn-engine-run", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
