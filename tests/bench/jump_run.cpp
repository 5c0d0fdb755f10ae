// SPDX-License-Identifier: Apache-2.0
//
// Maps several recordings with the engines and then shows the frame loop of cairn-track, as a reader, pieces
// of them in turn: a camera that jumps from place to place. In one process without DDS; the relocalizer
// answers and the replica is there before the next frame, as in lockstep.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <optional>
#include <vector>

#include "client/app/adapters.h"
#include "client/app/frame_loop.h"
#include "common/base/log.h"
#include "common/io/text.h"
#include "tests/bench/engine_link.h"
#include "tests/bench/json_file.h"
#include "tests/bench/jump_judge.h"
#include "tests/bench/recorded_map.h"
#include "tests/bench/timing.h"
#include "tests/bench/truth.h"

namespace cairn {
namespace {

constexpr size_t kPieceFrames = 25;
constexpr int64_t kFrameNs = 33'333'333;

struct Arguments {
  std::vector<std::string> places;  ///< name, source, truth, frames mapped, tolerance [m], and so on
  std::vector<std::string> others;
  std::string jumps;
  std::string json;
  uint64_t seed = 1;
  bool check = false;
  bool verbose = false;
};
constexpr size_t kPlaceFields = 5;

/// A recording: mapped from its beginning, kept where somebody jumps to it.
struct Place {
  CameraPtr camera;
  MapSnapshotPtr map;
  std::map<uint64_t, Frame> frames;
  Truth truth;
  Similarity3 truth_from_map;
  double tolerance = 0;  ///< [m]
};

Result<Place> make_place(std::span<const std::string> fields, uint8_t id, const std::vector<Jump>& jumps,
                         uint64_t seed, PlaceIndex* index) {
  auto source = open_aloud(fields[1]);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(**source, fields[1], "");
  if (!camera) return tl::unexpected(camera.error());
  const auto exact = read_trajectory(fields[2]);
  if (!exact) return tl::unexpected(exact.error());
  MapId map;
  map.bytes[0] = id;
  const auto recorded = map_beginning(source->get(), std::stoul(fields[3]), *camera, map, seed);
  if (!recorded) return tl::unexpected(recorded.error());
  index->put(recorded->map);
  Place place{*camera, recorded->map->snapshot, {}, Truth(*exact), {}, std::stod(fields[4])};
  const auto aligned = align(recorded->poses, place.truth);
  if (!aligned) return tl::unexpected(aligned.error());
  place.truth_from_map = *aligned;
  for (auto next = (*source)->next(); !next || *next; next = (*source)->next()) {
    if (!next) continue;
    const uint64_t at = (*next)->index;
    for (const Jump& jump : jumps) {
      if (jump.place == fields[0] && at >= jump.first_frame && at < jump.first_frame + kPieceFrames)
        place.frames.emplace(at, **next);
    }
  }
  return place;
}

using Places = std::map<std::string, Place>;

/// The pieces one after another, under the stamps of one camera: theirs jump back and forth.
class JumpingCamera final : public FrameSource {
 public:
  struct Shown {
    const Place* place = nullptr;
    const Frame* frame = nullptr;  ///< as recorded
  };

  /// kNotFound: a recording ends before the piece does, or has no place.
  [[nodiscard]] static Result<JumpingCamera> make(const Places& places, const std::vector<Jump>& jumps) {
    JumpingCamera camera;
    for (const Jump& jump : jumps) {
      const auto place = places.find(jump.place);
      if (place == places.end()) return fail(ErrorCode::kNotFound, jump.place + ": no such --place");
      for (size_t i = 0; i < kPieceFrames; ++i) {
        const auto frame = place->second.frames.find(jump.first_frame + i);
        if (frame == place->second.frames.end())
          return fail(ErrorCode::kNotFound, fmt::format("{}: no frame {}", jump.place, jump.first_frame + i));
        camera.shown_.push_back({&place->second, &frame->second});
      }
    }
    return camera;
  }

  Result<std::optional<Frame>> next() override {
    if (next_ == shown_.size()) return std::nullopt;
    const auto time = Timestamp{static_cast<int64_t>(next_ + 1) * kFrameNs};
    const Frame frame{next_, time, shown_[next_].frame->image};
    ++next_;
    return frame;
  }
  std::optional<size_t> frame_count() const override { return shown_.size(); }
  std::string describe() const override { return "jumps"; }
  [[nodiscard]] const Shown& shown(size_t number) const { return shown_[number]; }

 private:
  JumpingCamera() = default;
  std::vector<Shown> shown_;
  size_t next_ = 0;
};

/// Compares each frame's pose with the truth of what was shown.
class JumpObserver final : public FrameObserver {
 public:
  explicit JumpObserver(const JumpingCamera& camera, bool verbose) : camera_(camera), verbose_(verbose) {}

  void on_frame(const FrameReport& report) override {
    const JumpingCamera::Shown& shown = camera_.shown(report.number);
    const FrameResult& result = report.result;
    SeenFrame seen;
    if (is_tracked(report.state)) {
      seen.pose = SeenFrame::Pose::kPublished;
    } else if (result.verifying) {
      seen.pose = SeenFrame::Pose::kVerifying;
    }
    seen.right_map = result.map == shown.place->map->map;
    std::string text = "-";
    if (seen.pose != SeenFrame::Pose::kNone && seen.right_map) {
      if (const auto exact = shown.place->truth.interpolated(shown.frame->time)) {
        const Offset off = compare(shown.place->truth_from_map, result.camera_from_map, *exact);
        seen.right_pose = off.is_right(shown.place->tolerance);
        text = fmt::format("{:.1f} mm {:.2f} deg", off.metres * 1e3, off.degrees);
      }
    }
    frames_.push_back(seen);
    if (!verbose_) return;
    std::printf("  %4zu %-8s map %d%s %3d of %3d  %s  %s\n", report.number % kPieceFrames,
                to_string(report.state), static_cast<int>(result.map.bytes[0]),
                result.verifying ? " verifying" : "", result.found, result.attempted, text.c_str(),
                result.note.c_str());
  }
  [[nodiscard]] std::span<const SeenFrame> piece(size_t jump) const {
    return std::span(frames_).subspan(jump * kPieceFrames, kPieceFrames);
  }

 private:
  const JumpingCamera& camera_;
  bool verbose_;
  std::vector<SeenFrame> frames_;
};

std::string text(const std::optional<size_t>& frame) {
  return frame ? fmt::format("{}", *frame) : "-";
}

/// The number of a frame as JSON; null for no frame.
nlohmann::json json_of(const std::optional<size_t>& frame) {
  return frame ? nlohmann::json(*frame) : nlohmann::json();
}

Status write_outcomes(const std::vector<Jump>& jumps, const JumpObserver& observer, const std::string& path) {
  nlohmann::json figures = nlohmann::json::array();
  for (size_t j = 0; j < jumps.size(); ++j) {
    const JumpOutcome o = judge_jump(observer.piece(j));
    figures.push_back({{"place", jumps[j].place},
                       {"first_frame", jumps[j].first_frame},
                       {"right", json_of(o.right)},
                       {"published", json_of(o.published)},
                       {"wrong_map", o.wrong_map},
                       {"wrong_pose", o.wrong_pose},
                       {"without", o.without}});
  }
  return write_figures(path, figures);
}

/// What must hold: every jump recovered, half of them by the second frame, no pose wrong.
Status report(const std::vector<Jump>& jumps, const JumpObserver& observer, bool check) {
  std::vector<double> right;
  std::vector<double> published;
  JumpOutcome sum;
  std::printf("%-20s %6s %6s %9s %9s %10s %12s\n", "jump to", "frame", "right", "published", "wrong map",
              "wrong pose", "without pose");
  for (size_t j = 0; j < jumps.size(); ++j) {
    const JumpOutcome o = judge_jump(observer.piece(j));
    std::printf("%-20s %6lu %6s %9s %9zu %10zu %12zu\n", jumps[j].place.c_str(),
                static_cast<unsigned long>(jumps[j].first_frame), text(o.right).c_str(),
                text(o.published).c_str(), o.wrong_map, o.wrong_pose, o.without);
    if (o.right) right.push_back(static_cast<double>(*o.right));
    if (o.published) published.push_back(static_cast<double>(*o.published));
    sum.wrong_map += o.wrong_map;
    sum.wrong_pose += o.wrong_pose;
    sum.without += o.without;
  }
  std::printf(
      "jumps %zu recovered %zu; frames to the first right and later verified pose p50 %.0f p95 %.0f max "
      "%.0f, to the first published p50 %.0f p95 %.0f max %.0f; frames in a wrong map %zu, with a wrong pose "
      "%zu, without a pose %zu of %zu\n",
      jumps.size(), right.size(), percentile(right, 0.5), percentile(right, 0.95), percentile(right, 1),
      percentile(published, 0.5), percentile(published, 0.95), percentile(published, 1), sum.wrong_map,
      sum.wrong_pose, sum.without, jumps.size() * kPieceFrames);
  const bool holds = right.size() == jumps.size() && percentile(right, 0.5) <= 2 && sum.wrong_map == 0 &&
                     sum.wrong_pose == 0;
  if (check && !holds) return fail(ErrorCode::kInternal, "not what must hold");
  return {};
}

Result<Places> make_places(const Arguments& arguments, const std::vector<Jump>& jumps, PlaceIndex* index) {
  if (arguments.places.size() % kPlaceFields != 0)
    return fail(ErrorCode::kUsage, "--place needs NAME SOURCE TRUTH FRAMES TOLERANCE");
  Places places;
  uint8_t id = 1;
  for (size_t i = 0; i < arguments.places.size(); i += kPlaceFields) {
    const auto fields = std::span(arguments.places).subspan(i, kPlaceFields);
    auto place = make_place(fields, id++, jumps, arguments.seed, index);
    if (!place) return fail(place.error().code, fields[0] + ": " + place.error().message);
    places.emplace(fields[0], std::move(*place));
  }
  if (const Status done = map_others(arguments.others, id, arguments.seed, index); !done)
    return tl::unexpected(done.error());
  return places;
}

Status run(const Arguments& arguments) {
  const auto content = read_text_file(arguments.jumps);
  if (!content) return tl::unexpected(content.error());
  const auto jumps = parse_jumps(*content);
  if (!jumps) return fail(jumps.error().code, arguments.jumps + ": " + jumps.error().message);
  PlaceIndex index;
  const auto places = make_places(arguments, *jumps, &index);
  if (!places) return tl::unexpected(places.error());
  auto camera = JumpingCamera::make(*places, *jumps);
  if (!camera) return tl::unexpected(camera.error());

  // One camera jumps; the recordings' cameras differ by half a pixel.
  const CameraPtr& lens = places->begin()->second.camera;
  TrackerOptions reader;
  reader.make_maps = false;
  reader.make_keyframes = false;
  reader.seed = arguments.seed;
  TrackerAdapter tracker(lens, reader);
  EngineLink link(index, lens);
  SteadyClock clock;
  FrameLoopOptions options;
  options.pace = Pace::kLockstep;
  options.width = lens->width();
  options.height = lens->height();
  options.make_maps = false;
  JumpObserver observer(*camera, arguments.verbose);
  FrameLoop loop(*camera, tracker, link, clock, options, {&observer});
  if (const auto done = loop.run([] { return false; }); !done) return tl::unexpected(done.error());
  std::printf("maps %zu keyframes %zu\n", index.maps().size(), index.keyframe_count());
  std::printf("queries %zu; answer p50 %.2f p95 %.2f ms\n", link.answer_ms().size(),
              percentile(link.answer_ms(), 0.5), percentile(link.answer_ms(), 0.95));
  if (Status done = write_outcomes(*jumps, observer, arguments.json); !done) return done;
  return report(*jumps, observer, arguments.check);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Maps of several recordings, then a reader that jumps between them, without DDS");
  cairn::Arguments arguments;
  app.add_option("--place", arguments.places, "NAME SOURCE TRUTH FRAMES TOLERANCE, once for each recording")
      ->required();
  app.add_option("--also", arguments.others, "a recording of another place, mapped too; any number of times");
  app.add_option("--jumps", arguments.jumps, "rows `name first_frame`, in the order they are played")
      ->required();
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_option("--json", arguments.json, "write the figures here, for write-figures")->type_name("FILE");
  app.add_flag("--check", arguments.check,
               "ends with 1 unless all jumps are recovered, in 2 frames at the median, and no pose is wrong");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per frame");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    cairn::say_error("cairn-jump-run", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
