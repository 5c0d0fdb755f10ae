// SPDX-License-Identifier: Apache-2.0
//
// Plays a source through tracker and map maker in one process and one thread, without DDS: the engines by
// themselves, every unit of map work finished before the next frame. What a change of an engine does shows
// here first; real runs are tests/bench/run-accuracy's.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <map>
#include <string_view>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/tracking/tracker.h"
#include "common/geometry/camera_guess.h"
#include "common/io/calibration.h"
#include "common/io/trajectory.h"
#include "server/mapping/adjustment.h"
#include "server/mapping/map_maker.h"
#include "server/relocalization/relocalizer.h"
#include "tests/bench/bundle_file.h"

namespace cairn {
namespace {

double thread_cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

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

double percentile(std::vector<double> values, double p) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(p * static_cast<double>(values.size() - 1))];
}

struct Arguments {
  std::string source;
  std::string calibration;
  std::string trajectory;
  std::string keyframes;
  uint64_t seed = 1;
  bool ceres = false;
  double start_focal = 1;
  size_t skip = 0;
  std::string bundle;
  size_t frames = SIZE_MAX;
  size_t after_start = SIZE_MAX;
  bool local_only = false;
  std::vector<size_t> hidden;  ///< pairs: frame, count; something passes in front of the camera
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
  size_t questions = 0, places = 0;
  long first_map_frame = -1;
  std::vector<double> cpu_ms, attempted, found, seed_ms, keyframe_ms;
  AdjustmentTotals local, global;
};

class EngineRun {
 public:
  EngineRun(const Arguments& arguments, CameraPtr camera, std::optional<CameraDoubt> doubt)
      : arguments_(arguments), camera_(std::move(camera)), doubt_(std::move(doubt)) {
    tracker_options_.seed = arguments.seed;
    maker_options_.seed = arguments.seed;
    if (arguments.ceres) maker_options_.adjuster = Adjuster::kCeres;
    tracker_ = std::make_unique<Tracker>(camera_, tracker_options_);
  }

  void frame(const Frame& frame, TrajectoryWriter* trajectory) {
    const double before = thread_cpu_ms();
    const bool hidden = is_hidden(frame.index);
    const FrameResult& result =
        tracker_->track(hidden ? black(*frame.image) : frame.image, frame.time, snapshot_, &probe_);
    totals_.cpu_ms.push_back(thread_cpu_ms() - before);
    probe_.finish_frame();
    ++totals_.frames;
    if (snapshot_) count(frame, result, trajectory);
    // Alone, a tracker is told no more than that there is no map yet.
    if (result.place_question && (arguments_.ask || !snapshot_)) answer(*result.place_question);
    note_recovery(frame.index, hidden, result.pose_measured);
    if (result.seed) seed(*result.seed, frame);
    if (result.keyframe) offer(*result.keyframe, frame);
    if (arguments_.verbose) print_frame(frame, result);
  }

  /// Keyframes as they are after the run.
  Status write_keyframes(TrajectoryWriter* file) const {
    for (const auto& [id, time] : keyframe_times_) {
      const KeyframePose* keyframe = snapshot_ ? snapshot_->find(id) : nullptr;
      if (keyframe == nullptr) continue;
      auto written =
          file->append(snapshot_->map, snapshot_->name, {time, keyframe->camera_from_map.inverse()});
      if (!written) return written;
    }
    return {};
  }

  /// Enough frames were tracked with a map.
  [[nodiscard]] bool done() const { return totals_.with_map >= arguments_.after_start; }

  /// The problem of a global adjustment of the map as it is now.
  [[nodiscard]] Status write_global_problem(const std::string& path) const {
    if (!maker_) return fail(ErrorCode::kNotFound, path + ": no map was made");
    return write_bundle(path, maker_->prepare_global_adjustment()->problem.bundle);
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
    std::printf("questions %zu, places found %zu\n", t.questions, t.places);
    for (const auto& [reason, n] : refusals_) std::printf("  refused %zu: %s\n", n, reason.c_str());
    if (maker_) {
      const MapStatistics m = maker_->statistics();
      std::printf("map: %zu keyframes %zu points %zu measurements, %.2f MB, reprojection %.3f px\n",
                  m.keyframes, m.points, m.measurements, static_cast<double>(m.bytes) / 1e6,
                  maker_->reprojection_rms());
    }
  }

 private:
  void count(const Frame& frame, const FrameResult& result, TrajectoryWriter* trajectory) {
    ++totals_.with_map;
    if (result.state == TrackingState::kLost) ++totals_.lost;
    if (!result.pose_measured) return;
    ++totals_.tracked;
    totals_.attempted.push_back(result.attempted);
    totals_.found.push_back(result.found);
    if (trajectory != nullptr) {
      static_cast<void>(trajectory->append(snapshot_->map, snapshot_->name,
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
  void note_recovery(size_t index, bool hidden, bool posed) {
    if (hidden) {
      free_since_ = index + 1;
    } else if (free_since_ > 0 && posed) {
      std::printf("frame %zu: hidden before, tracked again after %zu frames\n", index,
                  index - free_since_ + 1);
      free_since_ = 0;
    }
  }

  /// The relocalizer's answer, there before the next frame as in lockstep.
  void answer(const PlaceView& view) {
    const PlaceAnswer said = relocalize(index_, *camera_, view);
    ++totals_.questions;
    std::optional<PoseSuggestion> place;
    if (said.verdict == PlaceVerdict::kConfirmed) {
      ++totals_.places;
      const PlaceCandidate& best = said.candidates.front();
      place = PoseSuggestion{best.map, best.epoch, best.keyframe, best.camera_from_keyframe};
    }
    tracker_->place_answered(place);
  }

  void print_frame(const Frame& frame, const FrameResult& result) const {
    std::printf("%5lu state %d found %d/%d rms %.2f depth %.2f %s\n", static_cast<unsigned long>(frame.index),
                static_cast<int>(result.state), result.found, result.attempted, result.reprojection_rms,
                result.mean_depth, result.note.c_str());
  }

  void seed(const SeedProposal& proposal, const Frame& frame) {
    SeedInput input;
    input.map.bytes[0] = 1;
    input.map_name = "map-1";
    input.epoch = Epoch{1};
    input.camera = camera_;
    input.doubt = doubt_;
    input.first_time = proposal.first_time;
    input.second_time = proposal.second_time;
    input.first_image = proposal.first_image;
    input.second_image = proposal.second_image;
    input.trails = proposal.trails;
    input.second_from_first = proposal.second_from_first;
    const double before = thread_cpu_ms();
    auto started = MapMaker::start(input, maker_options_);
    totals_.seed_ms.push_back(thread_cpu_ms() - before);
    if (!started) {
      std::printf("frame %lu: seed refused: %s\n", static_cast<unsigned long>(frame.index),
                  started.error().message.c_str());
      tracker_->seed_refused(started.error().message);
      return;
    }
    maker_ = std::move(started->first);
    keyframe_times_ = {{started->second.first_keyframe, proposal.first_time},
                       {started->second.second_keyframe, proposal.second_time}};
    work();
    totals_.first_map_frame = static_cast<long>(frame.index);
    std::printf("frame %lu: map started, %zu trails of %zu, %.0f ms, plane %d, %zu points\n",
                static_cast<unsigned long>(frame.index), started->second.points.size(),
                proposal.trails.size(), totals_.seed_ms.back(), started->second.plane_aligned,
                maker_->statistics().points);
    if (arguments_.verbose) print_start(*started, proposal);
    tracker_->seed_accepted({snapshot_->map, snapshot_->epoch, snapshot_->revision,
                             started->second.second_keyframe, started->second.points});
  }

  void print_start(const std::pair<std::unique_ptr<MapMaker>, SeedResult>& started,
                   const SeedProposal& proposal) {
    const KeyframePose* first = snapshot_->find(started.second.first_keyframe);
    const KeyframePose* second = snapshot_->find(started.second.second_keyframe);
    if (first == nullptr || second == nullptr) return;
    const SE3 step = second->camera_from_map * first->camera_from_map.inverse();
    const Eigen::Vector3d t = step.translation();
    const Eigen::Vector3d r = so3_log(step.rotation());
    std::printf("start: %.6f %.6f depth %.3f t %.5f %.5f %.5f r %.5f %.5f %.5f\n",
                proposal.first_time.seconds(), proposal.second_time.seconds(),
                static_cast<double>(first->mean_depth), t.x(), t.y(), t.z(), r.x(), r.y(), r.z());
  }

  void offer(const KeyframeProposal& proposal, const Frame& frame) {
    const double before = thread_cpu_ms();
    const KeyframeDecision decision =
        maker_->add_keyframe({camera_, frame.time, frame.image, proposal.reference,
                              proposal.camera_from_reference, proposal.measurements, doubt_});
    totals_.keyframe_ms.push_back(thread_cpu_ms() - before);
    if (decision.verdict != KeyframeVerdict::kAccepted) {
      ++totals_.refused;
      ++refusals_[decision.reason.substr(0, 40)];
      return;
    }
    ++totals_.accepted;
    keyframe_times_[decision.keyframe] = frame.time;
    work();
  }

  void work() {
    for (;;) {
      const double before = thread_cpu_ms();
      const StepReport report = maker_->step([] { return false; });
      if (report.work == MapWork::kLocalAdjustment) totals_.local.add(thread_cpu_ms() - before, report);
      if (report.work != MapWork::kNone) continue;
      if (arguments_.local_only || !maker_->wants_global_adjustment()) break;
      const auto problem = maker_->prepare_global_adjustment();
      solve(problem.get(), [] { return false; });
      const StepReport adopted = maker_->adopt(*problem);
      totals_.global.add(thread_cpu_ms() - before, adopted);
    }
    snapshot_ = maker_->snapshot();
    index_.put(index_map(index_.find(snapshot_->map), snapshot_, maker_->keyframe_views()));
    for (const CameraEstimate& estimate : maker_->statistics().cameras) use(estimate);
  }

  void use(const CameraEstimate& estimate) {
    if (!doubt_ || estimate.version == doubt_->version) return;
    camera_ = estimate.camera;
    doubt_ = estimate.frozen ? std::nullopt : std::optional(CameraDoubt{estimate.version, estimate.sigma});
    tracker_->use_camera(camera_);
    const auto& values = camera_->parameters().values;
    std::printf("frame %zu: camera version %u: f %.2f +- %.2f, k1 %.4f +- %.4f, %zu keyframes%s\n",
                totals_.frames, estimate.version.version, values[0], estimate.sigma[0] * values[0], values[4],
                estimate.sigma[1], snapshot_->keyframe_count(),
                estimate.frozen            ? ", frozen"
                : estimate.cannot_be_known ? ", cannot be known"
                                           : "");
  }

  Arguments arguments_;
  CameraPtr camera_;
  std::optional<CameraDoubt> doubt_;
  TrackerOptions tracker_options_;
  MapMakerOptions maker_options_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<MapMaker> maker_;
  MapSnapshotPtr snapshot_;
  PlaceIndex index_;
  size_t free_since_ = 0;
  CpuProbe probe_;
  Totals totals_;
  std::map<std::string, size_t> refusals_;
  std::map<KeyframeId, Timestamp> keyframe_times_;
};

constexpr std::string_view kAuto = "auto";
constexpr std::string_view kAutoFrom = "auto:";

struct ChosenCamera {
  CameraPtr camera;
  std::optional<CameraDoubt> doubt;
};

/// `auto` and the like: what is known of a camera that is found out.
Result<ChosenCamera> choose_doubtful_camera(const Arguments& arguments, const Frame& first) {
  const PictureSize size{first.image->width(), first.image->height()};
  DoubtfulCamera guess = guess_camera(size);
  if (arguments.calibration != kAuto) {
    const auto rough =
        read_calibration(arguments.calibration.substr(kAutoFrom.size()), size).and_then(doubt_camera);
    if (!rough) return tl::unexpected(rough.error());
    guess = *rough;
  }
  for (const size_t i : {0, 1}) guess.parameters.values[i] *= arguments.start_focal;
  const auto camera = make_camera(guess.parameters);
  if (!camera) return tl::unexpected(camera.error());
  return ChosenCamera{*camera, CameraDoubt{{{}, 1, 1}, {guess.focal_sigma, guess.k1_sigma}}};
}

Result<CameraPtr> choose_camera(const Arguments& arguments, const FrameSource& source) {
  if (!arguments.calibration.empty()) return read_calibration(arguments.calibration).and_then(make_camera);
  if (const auto known = source.builtin_calibration()) return make_camera(*known);
  if (const auto file = find_calibration(arguments.source))
    return read_calibration(*file).and_then(make_camera);
  return fail(ErrorCode::kConfiguration,
              arguments.source + ": no camera.txt beside it; pass --calibration FILE");
}

Status run(const Arguments& arguments) {
  auto source = open_source(arguments.source);
  if (!source) return tl::unexpected(source.error());
  std::optional<TrajectoryWriter> trajectory;
  if (!arguments.trajectory.empty()) {
    auto opened = TrajectoryWriter::open(arguments.trajectory);
    if (!opened) return tl::unexpected(opened.error());
    trajectory.emplace(std::move(*opened));
  }
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
      const bool is_doubtful = arguments.calibration == kAuto || arguments.calibration.starts_with(kAutoFrom);
      const auto chosen = is_doubtful ? choose_doubtful_camera(arguments, **next)
                                      : choose_camera(arguments, **source).map([](const CameraPtr& camera) {
                                          return ChosenCamera{camera, {}};
                                        });
      if (!chosen) return tl::unexpected(chosen.error());
      engine.emplace(arguments, chosen->camera, chosen->doubt);
    }
    engine->frame(**next, trajectory ? &*trajectory : nullptr);
    if (engine->done()) break;
  }
  if (!engine) return fail(ErrorCode::kDamaged, arguments.source + ": no frame could be read");
  engine->report();
  if (!arguments.keyframes.empty()) {
    auto file = TrajectoryWriter::open(arguments.keyframes);
    if (!file) return tl::unexpected(file.error());
    if (const auto written = engine->write_keyframes(&*file); !written) return written;
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
                 "camera file, auto or auto:FILE; default: beside the source");
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
  app.add_flag("!--alone", arguments.ask, "a lost tracker asks nobody");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per frame");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    std::fprintf(stderr, "cairn-engine-run: %s\n", done.error().message.c_str());
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
