// SPDX-License-Identifier: Apache-2.0
//
// Maps the first frames of a recording with the engines, in one process without DDS, and then asks the
// relocalizer where each of a list of later frames was taken: one query each, from scratch.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <optional>
#include <sstream>
#include <vector>

#include "common/base/log.h"
#include "common/image/frame_images.h"
#include "common/io/text.h"
#include "server/relocalization/relocalizer.h"
#include "tests/bench/answer_times.h"
#include "tests/bench/json_file.h"
#include "tests/bench/recorded_map.h"
#include "tests/bench/timing.h"
#include "tests/bench/truth.h"

namespace cairn {
namespace {

struct Arguments {
  std::string source, calibration, queries, sequence, truth, json;
  std::vector<std::string> foreign;
  std::vector<std::string> others;
  std::string method = "improved";
  size_t map_frames = 0;
  double tolerance = 0.05;
  uint64_t seed = 1;
  bool check = false;
  bool verbose = false;
};

/// Frame index -> whether a mapped view is near.
Result<std::map<uint64_t, bool>> read_queries(const Arguments& arguments) {
  const auto content = read_text_file(arguments.queries);
  if (!content) return tl::unexpected(content.error());
  std::map<uint64_t, bool> queries;
  for (const TextLine& line : data_lines(*content)) {
    std::istringstream row{std::string(line.text)};
    std::string name;
    uint64_t index = 0;
    double time = 0;
    int in_view = 0;
    if (row >> name >> index >> time >> in_view && name == arguments.sequence) queries[index] = in_view != 0;
  }
  return queries;
}

struct Tally {
  int asked = 0, answered = 0, right = 0, wrong = 0, verified_right = 0, verified_wrong = 0;

  [[nodiscard]] nlohmann::json json() const {
    return {{"asked", asked},
            {"answered", answered},
            {"right", right},
            {"wrong", wrong},
            {"verified_right", verified_right},
            {"verified_wrong", verified_wrong}};
  }
};

class Judge {
 public:
  Judge(const Arguments& arguments, const Truth& truth, const Similarity3& truth_from_map)
      : arguments_(arguments), truth_(truth), truth_from_map_(truth_from_map) {}

  void judge(const Frame& frame, bool in_view, const MapSnapshot& map, const RelocalizationAnswer& result) {
    Tally& tally = in_view ? in_view_ : elsewhere_;
    ++tally.asked;
    const PlaceCandidate* best = result.candidates.empty() ? nullptr : &result.candidates.front();
    std::string said = "-";
    if (result.verdict != RelocalizationVerdict::kNotKnown) {
      ++tally.answered;
      if (best->map != map.map) {
        ++tally.wrong;
        said = "WRONG MAP";
      } else if (const auto off = off_at(
                     frame.time, best->camera_from_keyframe * map.find(best->keyframe)->camera_from_map)) {
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

  /// The tracker's own pose some frames after the query; nothing: it believed none. False: no truth here.
  [[nodiscard]] bool judge_verification(const Frame& frame, bool in_view, const std::optional<SE3>& pose) {
    if (truth_.at(frame.time) == nullptr) return false;
    Tally& tally = in_view ? in_view_ : elsewhere_;
    if (!pose) return true;
    const auto off = off_at(frame.time, *pose);
    ++(is_right(*off) ? tally.verified_right : tally.verified_wrong);
    if (arguments_.verbose) {
      std::printf("%5lu   tracker: %s\n", static_cast<unsigned long>(frame.index), text(*off).c_str());
    }
    return true;
  }

  [[nodiscard]] nlohmann::json json() const {
    return {{"sequence", arguments_.sequence},
            {"method", arguments_.method},
            {"in_view", in_view_.json()},
            {"elsewhere", elsewhere_.json()}};
  }

  /// What must hold: no answer wrong, nor a pose that the tracker believes.
  [[nodiscard]] Status report() const {
    const auto row = [&](const char* what, const Tally& t) {
      std::printf("%s %-10s asked %d answered %d right %d wrong %d; tracker right %d wrong %d\n",
                  arguments_.sequence.c_str(), what, t.asked, t.answered, t.right, t.wrong, t.verified_right,
                  t.verified_wrong);
    };
    row("in view", in_view_);
    row("elsewhere", elsewhere_);
    const auto wrong_of = [](const Tally& t) { return t.wrong + t.verified_wrong; };
    const int wrong = wrong_of(in_view_) + wrong_of(elsewhere_);
    if (arguments_.check && wrong > 0)
      return fail(ErrorCode::kInternal, fmt::format("{}: {} wrong", arguments_.sequence, wrong));
    return {};
  }

 private:
  [[nodiscard]] std::optional<Offset> off_at(Timestamp time, const SE3& camera_from_map) const {
    const SE3* exact = truth_.at(time);
    if (exact == nullptr) return std::nullopt;
    return compare(truth_from_map_, camera_from_map, *exact);
  }
  [[nodiscard]] bool is_right(const Offset& off) const { return off.is_right(arguments_.tolerance); }
  [[nodiscard]] std::string text(const Offset& off) const {
    return fmt::format("{} {:.1f} mm {:.2f} deg", is_right(off) ? "right" : "WRONG", off.metres * 1e3,
                       off.degrees);
  }

  const Arguments& arguments_;
  const Truth& truth_;
  Similarity3 truth_from_map_;
  Tally in_view_, elsewhere_;
};

/// Asks for every few frames of a recording of somewhere else: whatever is answered is wrong.
Status ask_foreign(const std::string& foreign, const PlaceIndex& index, const RelocOptions& options,
                   bool verbose) {
  constexpr uint64_t kEvery = 5;
  auto source = open_aloud(foreign);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(**source, foreign, "");
  if (!camera) return tl::unexpected(camera.error());
  int asked = 0;
  int answered = 0;
  AnswerTimes times;
  for (;;) {
    const auto next = (*source)->next();
    if (!next) continue;
    if (!*next) break;
    const Frame& frame = **next;
    if (frame.index % kEvery != 0) continue;
    FrameImages images;
    images.build_pyramid(frame.image->view());
    const PlaceView view = describe_place(images.pyramid, images.all_corners());
    const double begin = thread_cpu_ms();
    const RelocalizationAnswer result = relocalize(index, **camera, view, options);
    times.add(result.candidates.size(), thread_cpu_ms() - begin);
    ++asked;
    if (result.verdict == RelocalizationVerdict::kNotKnown) continue;
    ++answered;
    if (verbose) std::printf("%s %lu: WRONG\n", foreign.c_str(), static_cast<unsigned long>(frame.index));
  }
  std::printf("%s, never mapped: asked %d answered %d; %s\n", foreign.c_str(), asked, answered,
              times.text().c_str());
  return {};
}

/// A tracker that is told of a place and nothing else, and has some frames to verify it.
struct Verification {
  std::unique_ptr<Tracker> tracker;
  uint64_t asked = 0;
  bool in_view = false;
};
constexpr uint64_t kVerificationFrames = 3;  // as the peers were judged

/// Asks for the listed frames among those that are left in the source; how long the answers took.
AnswerTimes ask(FrameSource* source, const std::map<uint64_t, bool>& queries, const CameraPtr& camera,
                const MapSnapshotPtr& map, const PlaceIndex& index, const RelocOptions& options,
                Judge* judge) {
  std::vector<double> describe_ms;
  AnswerTimes times;
  Verification verification;
  TrackerOptions told;
  told.make_maps = false;
  told.make_keyframes = false;
  for (;;) {
    auto next = source->next();
    if (!next) continue;
    if (!*next) break;
    const Frame& frame = **next;
    if (verification.tracker) {
      const FrameResult& tracked = verification.tracker->track(frame.image, frame.time, map);
      const auto pose = tracked.pose_measured ? std::optional(tracked.camera_from_map) : std::nullopt;
      if (frame.index - verification.asked >= kVerificationFrames &&
          judge->judge_verification(frame, verification.in_view, pose)) {
        verification.tracker.reset();
      }
    }
    const auto query = queries.find(frame.index);
    if (query == queries.end()) continue;
    FrameImages images;
    images.build_pyramid(frame.image->view());
    const double begin = thread_cpu_ms();
    const PlaceView view = describe_place(images.pyramid, images.all_corners());
    const double described = thread_cpu_ms();
    const RelocalizationAnswer result = relocalize(index, *camera, view, options);
    describe_ms.push_back(described - begin);
    times.add(result.candidates.size(), thread_cpu_ms() - described);
    judge->judge(frame, query->second, *map, result);
    if (result.verdict == RelocalizationVerdict::kNotKnown) continue;
    const PlaceCandidate& best = result.candidates.front();
    if (best.map != map->map) continue;
    verification = {std::make_unique<Tracker>(camera, told), frame.index, query->second};
    verification.tracker->relocalization_answered(
        PoseHypothesis{best.map, best.epoch, best.keyframe, best.camera_from_keyframe});
  }
  std::printf("maps %zu keyframes %zu; describing p50 %.2f ms; %s\n", index.maps().size(),
              index.keyframe_count(), percentile(describe_ms, 0.5), times.text().c_str());
  return times;
}

Status run(const Arguments& arguments) {
  auto source = open_aloud(arguments.source);
  if (!source) return tl::unexpected(source.error());
  auto camera = choose_camera(**source, arguments.source, arguments.calibration);
  if (!camera) return tl::unexpected(camera.error());
  const auto queries = read_queries(arguments);
  if (!queries) return tl::unexpected(queries.error());
  const auto exact = read_trajectory(arguments.truth);
  if (!exact) return tl::unexpected(exact.error());
  const Truth truth(*exact);

  MapId id;
  id.bytes[0] = 1;
  const auto mapped = map_beginning(source->get(), arguments.map_frames, *camera, id, arguments.seed);
  if (!mapped) return tl::unexpected(mapped.error());
  PlaceIndex index;
  index.put(mapped->map);
  if (const Status done = map_others(arguments.others, 2, arguments.seed, &index); !done) return done;
  const auto truth_from_map = align(mapped->poses, truth);
  if (!truth_from_map) return tl::unexpected(truth_from_map.error());
  RelocOptions options;
  options.method = arguments.method == "paper" ? RelocMethod::kPaper : RelocMethod::kImproved;
  Judge judge(arguments, truth, *truth_from_map);
  const AnswerTimes times =
      ask(source->get(), *queries, *camera, mapped->map->snapshot, index, options, &judge);
  for (const std::string& foreign : arguments.foreign) {
    if (const Status done = ask_foreign(foreign, index, options, arguments.verbose); !done) return done;
  }
  nlohmann::json figures = judge.json();
  figures["answer_ms"] = spread_json(times.all());
  if (const Status done = write_figures(arguments.json, figures); !done) return done;
  return judge.report();
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
  app.add_option("--foreign", arguments.foreign, "a recording of somewhere else, any number of times");
  app.add_option("--also", arguments.others, "a recording of another place, mapped too; any number of times");
  app.add_option("--method", arguments.method, "improved or paper")
      ->check(CLI::IsMember({"improved", "paper"}));
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_option("--json", arguments.json, "write the figures here, for write-figures")->type_name("FILE");
  app.add_flag("--check", arguments.check, "ends with 1 if any answer or pose is wrong");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per query");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    cairn::say_error("cairn-reloc-run", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
