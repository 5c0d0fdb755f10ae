// SPDX-License-Identifier: Apache-2.0
#include "client/app/application.h"

#include <spdlog/fmt/fmt.h>
#include <sys/resource.h>

#include <chrono>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "client/app/adapters.h"
#include "client/app/calibration_saver.h"
#include "client/app/frame_loop.h"
#include "client/app/images/image_link.h"
#include "client/app/memory_source.h"
#include "client/app/narrator.h"
#include "client/app/rig_link.h"
#include "client/app/rig_pilot.h"
#include "client/app/run_outputs.h"
#include "client/app/stats.h"
#include "client/app/viewer/display.h"
#include "client/app/viewer/timed_labels.h"
#include "client/app/viewer/viewer.h"
#include "client/capture/decode_ahead.h"
#include "client/capture/frame_source.h"
#include "client/session/session.h"
#include "common/base/exit_deadline.h"
#include "common/geometry/camera_guess.h"
#include "common/io/calibration.h"
#include "common/wire/log_redirect.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr int kInterruptedExit = 130;
constexpr int kNoPosesExit = 1;  ///< a trajectory was asked for, and there is none worth the name
constexpr milliseconds kServerPatience(10'000);  ///< to be seen at the start of a recording
constexpr milliseconds kPatienceSlice(100);      ///< how long a request to stop may go unheard
constexpr milliseconds kLastVerdicts(2'000);     ///< for offers undecided at the end
/// A crashed process holds its name at the server for 3 s of silence: its successor may be refused that long.
constexpr milliseconds kNameGrace(4'000);
constexpr size_t kPreloadBytes = size_t{512} << 20;
constexpr int kFrameThreadNice = -10;

/// A camera, and how far its values are believed (SessionOptions::prior_sigma).
struct ChosenCamera {
  CameraPtr camera;
  std::vector<double> sigma;
  bool is_nominal = false;  ///< a calibration without distortion: refined, not calibrated anew
};

Result<ChosenCamera> make_from_prior(const IntrinsicsPrior& prior) {
  return make_camera(prior.parameters).map([&](CameraPtr camera) {
    return ChosenCamera{std::move(camera), sigma_of_values(prior)};
  });
}

/// An error that names the calibration, as those of reading it do already.
Result<ChosenCamera> of_file(const std::filesystem::path& path, Result<ChosenCamera> chosen) {
  if (!chosen && !chosen.error().message.starts_with(path.string()))
    return fail(chosen.error().code, path.string() + ": " + chosen.error().message);
  return chosen;
}

Result<ChosenCamera> choose_unknown_camera(const TrackOptions& options, const FrameSource& source) {
  const auto exact = source.builtin_calibration();
  const auto size = exact ? ImageSize{exact->width, exact->height} : source.image_size();
  if (options.calibration)
    return of_file(
        *options.calibration,
        read_calibration(*options.calibration, size).and_then(rough_prior).and_then(make_from_prior));
  if (!size) {
    return fail(ErrorCode::kConfiguration, options.source +
                                               ": the size of its images is not known before the first; "
                                               "pass a rough calibration with --calibration auto:FILE");
  }
  return make_from_prior(guess_camera(*size));
}

Result<ChosenCamera> choose_camera(const TrackOptions& options, const FrameSource& source) {
  if (options.find_camera) return choose_unknown_camera(options, source);
  const auto take = [](CameraPtr camera) { return ChosenCamera{std::move(camera), {}}; };
  if (!options.calibration) {
    if (const auto exact = source.builtin_calibration()) return make_camera(*exact).map(take);
  }
  const auto path = options.calibration ? options.calibration : find_calibration(options.source);
  if (!path && !options.reader) return choose_unknown_camera(options, source);
  if (!path) {
    return fail(ErrorCode::kConfiguration,
                "no calibration: there is no camera.txt beside " + options.source +
                    "; `cairn-track calibrate` makes a calibration from a board; pass --calibration FILE: "
                    "`width height fx fy cx cy [k1 k2 p1 p2 [k3]]`, or a calibration of Kalibr, OpenCV, ROS, "
                    "ORB-SLAM, VINS, COLMAP, LSD-SLAM, DSO, KITTI or PTAM");
  }
  const auto parameters = read_calibration(*path, source.image_size());
  if (!parameters) return tl::unexpected(parameters.error());
  const auto nominal = options.reader || options.exact_camera ? std::nullopt : nominal_camera(*parameters);
  if (nominal) {
    return of_file(*path, make_from_prior(*nominal)).map([](ChosenCamera&& chosen) {
      chosen.is_nominal = true;
      return std::move(chosen);
    });
  }
  return make_camera(*parameters).map(take);
}

/// A recording played in real time stands for a camera, whose images cost the processor nothing: as far as
/// memory allows it is decoded before the clock starts, else ahead of it.
std::unique_ptr<FrameSource> decode_ahead(std::unique_ptr<FrameSource> source, const TrackOptions& options,
                                          const Camera& camera, const Logger& log,
                                          const std::function<bool()>& stop_requested) {
  const size_t frame_bytes = static_cast<size_t>(camera.width()) * static_cast<size_t>(camera.height());
  const auto count = source->frame_count();
  if (options.pace == Pace::kRealtime && count && *count <= kPreloadBytes / frame_bytes) {
    log->info("decoding {} frames before the clock starts", *count);
    const auto report_progress = [&, done = size_t{0}, told = std::chrono::steady_clock::now()]() mutable {
      if (const auto now = std::chrono::steady_clock::now(); now - told >= std::chrono::seconds(1)) {
        log->info("decoded {} of {} frames", done, *count);
        told = now;
      }
      ++done;
      return stop_requested();
    };
    return std::make_unique<MemorySource>(*source, report_progress);
  }
  return std::make_unique<DecodeAhead>(std::move(source));
}

TrackerOptions tracker_options(const TrackOptions& options) {
  TrackerOptions tracker = options.tracker;
  tracker.make_maps = options.makes_maps();
  tracker.make_keyframes = !options.reader;
  tracker.seed = options.seed;
  return tracker;
}

SessionOptions session_options(const TrackOptions& options, const std::vector<double>& prior_sigma) {
  SessionOptions session;
  session.server = options.server;
  session.domain = options.domain;
  session.profile = options.profile;
  session.listen = options.listen;
  session.security = options.security;
  session.name = options.name;
  session.wearer = options.wearer;
  session.only_map = options.map;
  session.reads_only = options.reader;
  session.proposes = options.proposes;
  session.lockstep = options.pace == Pace::kLockstep;
  session.prior_sigma = prior_sigma;
  return session;
}

std::filesystem::path path_of_saved_calibration(const TrackOptions& options) {
  return options.saved_calibration.value_or("cairn-camera-" + options.name + ".yaml");
}

/// Told before the run what would be noticed after it. Where nobody has asked for the file, it is no error
/// that it cannot be written.
Status prepare_to_find_camera(const TrackOptions& options, const ChosenCamera& chosen, const Logger& log) {
  if (chosen.sigma.empty()) {
    if (!options.saved_calibration) return {};
    return fail(
        ErrorCode::kUsage,
        "--save-calibration: the camera is taken for exact and is not calibrated; pass --calibration auto, "
        "or auto:FILE");
  }
  const double sigma_percent = 100 * chosen.sigma.front() / chosen.camera->parameters().values.front();
  if (chosen.is_nominal) {
    log->info(
        "the calibration has no distortion: it is believed to {:.1f} % and refined while the map grows; "
        "--calibration exact:FILE takes it as it is",
        sigma_percent);
  } else {
    log->info(
        "the camera is calibrated while the map grows: focal length {:.0f} px +- {:.0f} % to begin with",
        chosen.camera->focal_length(), sigma_percent);
  }
  log->info(
      "maps know it as that of client '{}': a later run under the same --name takes up what is known of it",
      options.name);
  if (chosen.is_nominal && !options.saved_calibration) return {};
  const std::filesystem::path path = path_of_saved_calibration(options);
  Status writable = check_writable(path);
  if (!writable && options.saved_calibration) return writable;
  if (!writable) log->warn("{}; --save-calibration FILE names another", writable.error().message);
  std::error_code unknown;
  if (std::filesystem::exists(path, unknown))
    log->info("{} will be replaced once the camera is known", path.string());
  return {};
}

/// Waits, no longer than `patience`, for what a recording needs before its first frame. Returns whether that
/// is there; false, too, when a stop is requested. A live camera does not wait; a recording would be over
/// meanwhile.
bool await(const std::function<bool(milliseconds)>& is_there, milliseconds patience,
           const std::function<bool()>& stop_requested) {
  for (auto waited = milliseconds(0); waited < patience && !stop_requested(); waited += kPatienceSlice) {
    if (is_there(kPatienceSlice)) return true;
  }
  return false;
}

std::string no_server_text(const TrackOptions& options, const Session& session) {
  return "no cairn-server answers at " + options.server + " in domain " + std::to_string(options.domain) +
         ", asked " + session.network() +
         "; is it running, in the same domain and for this network (its --profile and --listen)? --listen "
         "here takes another interface" +
         (options.security.empty()
              ? ". A secured site speaks only to who shows keys of its own: --security DIR"
              : ". Or your keys are no longer accepted, or the server's are not by yours (a line of the "
                "middleware says \"certificate revoked\"): ask the operator");
}

/// The threads of DDS, decoder and video, started before, keep the ordinary priority. Needs CAP_SYS_NICE or
/// RLIMIT_NICE.
void prefer_this_thread(const Logger& log) {
  if (setpriority(PRIO_PROCESS, 0, kFrameThreadNice) != 0) {
    log->debug("no right to prefer the frame thread (nice {}): a busy machine may delay frames",
               kFrameThreadNice);
  }
}

int report_error(const Error& error, const Logger& log) {
  log->error("{}", error.message);
  return exit_code(error.code);
}

/// The link to the rig; null without a rig. Errors: kUsage (a recording cannot be carried by one), those of
/// RigLink::open().
Result<std::unique_ptr<RigLink>> open_rig(const TrackOptions& options, const FrameSource& source,
                                          const Logger& log) {
  if (options.rig.empty()) return std::unique_ptr<RigLink>();
  if (!source.is_live()) {
    return fail(ErrorCode::kUsage, "--rig: " + source.describe() +
                                       " is no camera that a rig can move; a live one is, v4l2:, or "
                                       "sim:shoulder?rig=PATH");
  }
  return RigLink::open({options.rig, options.name, options.domain, options.rig_aim, log, options.rig_search,
                        options.security, options.commander});
}

void press(RigCommander& commander, RigKey key) {
  switch (key) {
    case RigKey::kStop:
      return commander.stop();
    case RigKey::kClear:
      return commander.clear();
    case RigKey::kNeutral:
      return commander.want(RigAim::kNeutral);
    case RigKey::kFollow:
      return commander.want(RigAim::kFollow);
    case RigKey::kLock:
      return commander.want(RigAim::kLock);
    case RigKey::kFixate:
      return commander.want(RigAim::kFixate);
    case RigKey::kSearch:
      return commander.want(RigAim::kSearch);
  }
}

/// The link to the wearer's other cameras; null for a camera that is nobody's, and where it cannot be opened,
/// which is told: the camera is tracked all the same.
std::unique_ptr<ImageLink> open_images(const TrackOptions& options, const CameraPtr& camera,
                                       const Logger& log) {
  if (options.wearer.empty()) return nullptr;
  auto images =
      ImageLink::open({options.wearer, options.name, options.domain, options.security}, camera, log);
  if (images) return *std::move(images);
  log->warn("no images go between the cameras of wearer {}: {}", options.wearer, images.error().message);
  return nullptr;
}

void show_others(ViewerLink& link, ImageLink& images) {
  link.cameras = [&images] { return images.cameras(); };
  link.choose_camera = [&images](const std::string& camera) { images.choose(camera); };
  link.other = [&images] { return images.view(); };
}

ViewerLink viewer_link(Session& session, RigLink* rig = nullptr) {
  return {[&session](MapId map) { return session.labels(map); },
          [&session](wire::ClientRequest request) { session.send_request(std::move(request)); },
          [&session] { return session.take_request_replies(); },
          [rig](RigKey key) {
            if (rig == nullptr) return;
            if (key == RigKey::kStop) return rig->stop();
            rig->with([key](RigCommander& commander) { press(commander, key); });
          }};
}

/// A window where there is a display and one is wanted; else null, and said why.
std::unique_ptr<Viewer> open_viewer(const TrackOptions& options, const CameraPtr& camera, Session& session,
                                    RigLink* rig, ImageLink* images, const Logger& log) {
  if (options.headless) return nullptr;
  if (const std::string why = why_no_window(); !why.empty()) {
    log->info("no window: {}; running headless (--video shows the same)", why);
    return nullptr;
  }
  ViewerLink link = viewer_link(session, rig);
  if (images != nullptr) show_others(link, *images);
  return std::make_unique<Viewer>(
      camera, "cairn-track " + options.name,
      ViewerOptions{!options.reader, rig != nullptr, options.makes_maps(), options.wearer}, std::move(link),
      log);
}

/// All that is open while frames are tracked.
struct Run {
  const TrackOptions& options;
  const Logger& log;
  const RunSignals& signals;
  CameraPtr camera;
  ImuStreamPtr imu;        ///< of the source; may be null
  bool saves_calibration;  ///< writes it when it is known
  std::unique_ptr<FrameSource> source;
  std::unique_ptr<Session> session;
  std::unique_ptr<RigLink> rig;       ///< may be null
  std::unique_ptr<ImageLink> images;  ///< may be null
  std::unique_ptr<Viewer> viewer;     ///< may be null
  std::vector<TimedLabel> labels;     ///< to be placed on the way

  [[nodiscard]] bool stop_requested() const {
    return signals.stop_requested() || (viewer && viewer->quit_requested());
  }
  [[nodiscard]] bool new_map_requested() const {
    const bool by_key = viewer && viewer->take_new_map_request();
    return signals.new_map_requested() || by_key;
  }
};

Result<Run> prepare(const TrackOptions& options, const Logger& log, const RunSignals& signals) {
  auto source = open_source(options.source);
  if (!source) return tl::unexpected(source.error());
  tell_notes((**source).notes(), log);
  const auto chosen = choose_camera(options, **source);
  if (!chosen) return tl::unexpected(chosen.error());
  const CameraPtr& camera = chosen->camera;
  if (auto status = prepare_to_find_camera(options, *chosen, log); !status)
    return tl::unexpected(status.error());
  if (auto status = check_image_size(**source, camera->parameters()); !status)
    return tl::unexpected(status.error());
  auto imu = open_imu(options.source, **source, options.imu);
  if (!imu) return tl::unexpected(imu.error());
  tell_notes(imu->notes, log);
  Result<std::vector<TimedLabel>> labels;
  if (options.labels) labels = read_timed_labels(*options.labels, {camera->width(), camera->height()});
  if (!labels) return tl::unexpected(labels.error());
  const bool saves_calibration = !chosen->sigma.empty() && (!chosen->is_nominal || options.saved_calibration);
  const auto calibration = options.calibration ? options.calibration : find_calibration(options.source);
  const auto calibration_to_save =
      saves_calibration ? std::optional(path_of_saved_calibration(options)) : std::nullopt;
  if (auto status = check_outputs(options, calibration, calibration_to_save); !status)
    return tl::unexpected(status.error());
  log->info("{}; client '{}'", (*source)->describe(), options.name);
  log->info("camera: {}", describe_camera(camera->parameters()));
  auto session = Session::open(session_options(options, chosen->sigma), camera, log);
  if (!session) return tl::unexpected(session.error());
  auto rig = open_rig(options, **source, log);
  if (!rig) return tl::unexpected(rig.error());
  auto ahead = decode_ahead(std::move(*source), options, *camera, log, signals.stop_requested);
  auto images = open_images(options, camera, log);
  auto viewer = open_viewer(options, camera, **session, rig->get(), images.get(), log);
  return Run{options,
             log,
             signals,
             camera,
             std::move(imu->stream),
             saves_calibration,
             std::move(ahead),
             std::move(*session),
             *std::move(rig),
             std::move(images),
             std::move(viewer),
             std::move(*labels)};
}

/// How a run ended.
struct Ending {
  Status closed;        ///< its files
  Status kept;          ///< its camera, if that was to be calibrated
  bool at_end = false;  ///< of the source, or quit in the window; else interrupted
};

/// Why the map that was asked for was not there; nothing: it was there, or none in particular was asked for.
std::optional<Error> missing_map(const Run& run) {
  const std::string& map = run.options.map;
  const bool waits =
      run.session->status().waits_for_map;  // before the map is looked for: it may come between
  if (map.empty() || run.session->snapshot() != nullptr) return std::nullopt;
  if (waits) {
    return Error{ErrorCode::kNoServer,
                 "map '" + map + "' has not come from the server whole: it is large, or the network slow"};
  }
  return Error{ErrorCode::kRefused, "the server lists no map '" + map +
                                        "' to track in (`cairnctl maps` lists all, deleted ones too)"};
}

/// The exit code. What did not work is logged.
int judge(const Run& run, const RunStats& stats, const SessionStatus& session, const Ending& ending) {
  if (!ending.closed) return report_error(ending.closed.error(), run.log);
  if (!ending.kept && !run.options.saved_calibration) run.log->warn("{}", ending.kept.error().message);
  const int kept =
      !ending.kept && run.options.saved_calibration ? report_error(ending.kept.error(), run.log) : 0;
  if (session.link == ServerLink::kRefused) return report_error({ErrorCode::kRefused, session.text}, run.log);
  if (!ending.at_end) return kInterruptedExit;
  if (session.link == ServerLink::kConnecting)
    return report_error({ErrorCode::kNoServer, no_server_text(run.options, *run.session)}, run.log);
  if (const auto missing = missing_map(run)) return report_error(*missing, run.log);
  if (kept != 0) return kept;
  const size_t undecodable = stats.frames_total() - stats.frames_decoded();
  if (!run.source->is_live() && 2 * undecodable > stats.frames_total()) {
    return report_error(
        {ErrorCode::kDamaged, fmt::format("{}: {} of {} frames could not be decoded", run.options.source,
                                          undecodable, stats.frames_total())},
        run.log);
  }
  return 0;
}

/// The last words of a run whose poses are not what was asked for; a script notices by the exit code.
int tell_shortfall(const Run& run, const RunStats& stats, const std::string& why_no_map, int outcome) {
  const auto shortfall = stats.shortfall(why_no_map);
  if (!shortfall) {
    if (!why_no_map.empty()) run.log->warn("the run ends without a map: {}", why_no_map);
    return outcome;
  }
  run.log->error("{}", *shortfall);
  return outcome == 0 && run.options.trajectory ? kNoPosesExit : outcome;
}

int track(Run& run) {
  const auto stop = [&run] { return run.stop_requested(); };
  auto outputs = RunOutputs::open(run.options, run.camera, stop, run.log);
  if (!outputs) return report_error(outputs.error(), run.log);
  TrackerAdapter tracker(run.camera, tracker_options(run.options));
  SessionAdapter link(*run.session);
  SteadyClock clock;
  RunStats stats(run.options.stats ? RunStats::FrameList::kKept : RunStats::FrameList::kLeftOut);
  Narrator narrator(run.log, clock, run.source->frame_count());
  std::vector<FrameObserver*> observers = {&stats};
  for (FrameObserver* output : outputs->observers()) observers.push_back(output);
  if (run.viewer) observers.push_back(run.viewer.get());
  if (run.images) observers.push_back(run.images.get());
  std::optional<LabelPlacer> placer;
  if (run.options.labels)
    observers.push_back(&placer.emplace(run.labels, run.camera, viewer_link(*run.session), run.log));
  observers.push_back(&narrator);
  std::optional<RigPilot> pilot;
  if (run.rig) {
    observers.push_back(run.rig.get());
    observers.push_back(
        &pilot.emplace(run.camera, RigPilotOptions{run.options.fixated_label, run.options.makes_maps()},
                       [&run](const std::function<void(RigCommander&)>& task) { run.rig->with(task); }));
  }
  std::optional<CalibrationSaver> saver;
  if (run.saves_calibration)
    observers.push_back(&saver.emplace(path_of_saved_calibration(run.options), run.log));

  FrameLoopOptions loop_options;
  loop_options.pace = run.options.pace;
  loop_options.width = run.camera->width();
  loop_options.height = run.camera->height();
  loop_options.imu = run.rig ? &run.rig->imu() : run.imu.get();
  loop_options.make_maps = run.options.makes_maps();
  loop_options.lost_patience = std::chrono::seconds(run.options.lost_patience);
  loop_options.new_map_requested = [&run] { return run.new_map_requested(); };
  if (run.rig) loop_options.rig_text = [&run] { return run.rig->describe(); };
  FrameLoop loop(*run.source, tracker, link, clock, loop_options, observers);
  prefer_this_thread(run.log);
  // A process under a name in use is refused until the other one is gone: a camera goes on, a recording would
  // be in vain.
  const auto finished = loop.run([&] {
    const bool in_vain = run.options.pace != Pace::kRealtime && link.status().link == ServerLink::kRefused;
    return in_vain || run.stop_requested();
  });
  const bool quit = run.viewer && run.viewer->quit_requested();
  if (finished && (*finished || quit)) {
    (void)link.wait_until_settled(kLastVerdicts);
    loop.deliver_replies();
    loop.take_camera(link.snapshot());
  }
  narrator.finish();
  if (run.rig) {
    const auto counts = run.rig->with([](RigCommander& commander) { return commander.counts(); });
    stats.note_rig(
        {run.options.rig, run.rig->describe(), counts.searches, counts.candidates, pilot->fixated()});
    run.rig->close();
  }
  if (run.images) {
    run.images->close();
    stats.note_images(run.images->summary());
  }
  if (placer) placer->finish();
  const Status kept = saver ? saver->finish(stop) : Status();

  const auto session = link.status();
  const auto closed = outputs->close(stats, session.bytes_sent, session.bytes_received);
  if (stats.frames_decoded() > 0) {
    for (const auto& line : stats.summary_lines()) run.log->info("{}", line);
  }
  if (!finished) return report_error(finished.error(), run.log);
  const int outcome = judge(run, stats, session, {closed, kept, *finished || quit});
  if (session.link == ServerLink::kRefused || session.link == ServerLink::kConnecting) return outcome;
  return tell_shortfall(run, stats, narrator.why_no_map(), outcome);
}

/// Waits for what a recording needs, then tracks: the exit code.
int wait_and_track(Run& run) {
  const TrackOptions& options = run.options;
  const Logger& log = run.log;
  const auto stop = [&run] { return run.stop_requested(); };
  Session& session = *run.session;
  // Or it has said that it will not be there for us.
  const auto server_is_there = [&](milliseconds slice) {
    return session.wait_for_server(slice) || session.status().link == ServerLink::kRefused;
  };
  if (!run.source->is_live() && !server_is_there(kPatienceSlice)) {
    log->info("waiting for cairn-server at {} in domain {}, {}", options.server, options.domain,
              session.network());
  }
  if (!run.source->is_live() && !await(server_is_there, kServerPatience, stop) && !stop()) {
    if (options.pace != Pace::kRealtime)
      return report_error({ErrorCode::kNoServer, no_server_text(options, session)}, log);
    log->warn("{}; following the camera without maps until it comes", no_server_text(options, session));
  }
  const auto name_is_ours = [&](milliseconds slice) { return session.wait_for_name(slice); };
  if (!run.source->is_live()) (void)await(name_is_ours, kNameGrace, stop);
  const auto map_is_there = [&](milliseconds slice) { return session.wait_for_map(slice); };
  if (!run.source->is_live() && !options.map.empty() && !await(map_is_there, kServerPatience, stop) &&
      !stop()) {
    if (const auto missing = missing_map(run)) log->warn("{}; going on until it does", missing->message);
  }
  if (stop()) return kInterruptedExit;
  if (const auto status = session.status();
      options.pace != Pace::kRealtime && status.link == ServerLink::kRefused)
    return report_error({ErrorCode::kRefused, status.text}, log);
  return track(run);
}

}  // namespace

int run_tracker(const TrackOptions& options, const Logger& log, const RunSignals& signals) {
  const wire::LogRedirect middleware_log(log);
  auto run = prepare(options, log, signals);
  if (!run) return report_error(run.error(), log);
  const int code = wait_and_track(*run);
  const ExitDeadline deadline(code, kClosingPatience, log);
  run = fail(ErrorCode::kInternal, "closed");
  return code;
}

}  // namespace cairn
