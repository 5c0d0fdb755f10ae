// SPDX-License-Identifier: Apache-2.0
//
// Maps several recordings with the engines, in one process without DDS, and then shows one tracker pieces of
// them in turn: the camera jumps from place to place. The relocalizer answers before the next frame, as in
// lockstep.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <vector>

#include "server/relocalization/relocalizer.h"
#include "tests/bench/recorded_map.h"

namespace cairn {
namespace {

constexpr size_t kPieceFrames = 25;

struct Arguments {
  std::vector<std::string> places;  ///< name, source, truth, frames mapped, tolerance [m], and so on
  std::vector<std::string> others;
  std::string jumps;
  uint64_t seed = 1;
  bool verbose = false;
};
constexpr size_t kPlaceFields = 5;

struct Jump {
  std::string place;
  uint64_t first_frame = 0;
};

Result<std::vector<Jump>> read_jumps(const std::string& path) {
  std::ifstream file(path);
  if (!file) return fail(ErrorCode::kNotFound, path + ": cannot be read");
  std::vector<Jump> jumps;
  for (std::string line; std::getline(file, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream row(line);
    Jump jump;
    if (!(row >> jump.place >> jump.first_frame)) return fail(ErrorCode::kDamaged, path + ": " + line);
    jumps.push_back(jump);
  }
  return jumps;
}

/// A recording: mapped from its beginning, kept where somebody jumps to it.
struct Place {
  CameraPtr camera;
  MapSnapshotPtr map;
  std::map<uint64_t, Frame> frames;
  Truth truth;
  Similarity3 truth_from_map;
  double tolerance = 0;
};

Result<Place> make_place(std::span<const std::string> fields, uint8_t id, const std::vector<Jump>& jumps,
                         uint64_t seed, PlaceIndex* index) {
  const std::string& name = fields[0];
  auto source = open_source(fields[1]);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(fields[1], "");
  if (!camera) return tl::unexpected(camera.error());
  const auto exact = read_trajectory(fields[2]);
  if (!exact) return tl::unexpected(exact.error());
  Place place{*camera, {}, {}, Truth(*exact), {}, std::stod(fields[4])};
  MapId map;
  map.bytes[0] = id;
  Mapping mapping(*camera, map, seed);
  const auto indexed = map_beginning(source->get(), std::stoul(fields[3]), &mapping);
  if (!indexed) return tl::unexpected(indexed.error());
  index->put(*indexed);
  place.map = mapping.snapshot();
  const auto aligned = align(mapping.live(), place.truth);
  if (!aligned) return tl::unexpected(aligned.error());
  place.truth_from_map = *aligned;
  for (auto next = (*source)->next(); !next || *next; next = (*source)->next()) {
    if (!next) continue;
    const uint64_t at = (*next)->index;
    for (const Jump& jump : jumps) {
      if (jump.place == name && at >= jump.first_frame && at < jump.first_frame + kPieceFrames)
        place.frames.emplace(at, **next);
    }
  }
  return place;
}

/// What came of one jump. Frames count from 0, the first after the jump.
struct Outcome {
  std::optional<size_t> answered;   ///< whose answer was right and was proven by what followed
  std::optional<size_t> published;  ///< with the first pose of the tracker that is right
  size_t wrong_map = 0;             ///< frames with a pose in another map
  size_t wrong_pose = 0;            ///< frames with a pose in the right map, but not right
};

class Player {
 public:
  Player(const std::map<std::string, Place>& places, const PlaceIndex& index, uint64_t seed)
      : places_(places), index_(index) {
    TrackerOptions options;
    options.make_maps = false;
    options.make_keyframes = false;
    options.seed = seed;
    tracker_ = std::make_unique<Tracker>(places.begin()->second.camera, options);
    held_ = places.begin()->second.map;
  }

  Outcome play(const Place& place, uint64_t first_frame) {
    Outcome outcome;
    std::optional<size_t> candidate;
    for (size_t i = 0; i < kPieceFrames; ++i) {
      const auto frame = place.frames.find(first_frame + i);
      if (frame == place.frames.end()) continue;
      // The pieces' own times jump back and forth; a camera's do not.
      time_ = Timestamp{time_.nanoseconds + kFrameNs};
      const FrameResult& result = tracker_->track(frame->second.image, time_, held_);
      if (result.pose_measured) count(place, frame->second, result, i, &outcome);
      if (result.pose_measured && outcome.published == i) outcome.answered = candidate.value_or(i);
      if (!result.place_question) continue;
      const double before = thread_cpu_ms();
      const PlaceAnswer said = relocalize(index_, *place.camera, *result.place_question);
      answer_ms_.push_back(thread_cpu_ms() - before);
      std::optional<PoseSuggestion> suggestion;
      if (said.verdict == PlaceVerdict::kConfirmed) {
        const PlaceCandidate& best = said.candidates.front();
        suggestion = PoseSuggestion{best.map, best.epoch, best.keyframe, best.camera_from_keyframe};
        const auto& map = index_.find(best.map)->snapshot;
        const SE3 pose = best.camera_from_keyframe * map->find(best.keyframe)->camera_from_map;
        const SE3* exact = place.truth.at(frame->second.time);
        const bool right = map->map == place.map->map && exact != nullptr &&
                           compare(place.truth_from_map, pose, *exact).is_right(place.tolerance);
        candidate = right ? std::optional(i) : std::nullopt;
      }
      if (tracker_->place_answered(suggestion)) held_ = index_.find(suggestion->map)->snapshot;
    }
    return outcome;
  }
  [[nodiscard]] const std::vector<double>& answer_ms() const { return answer_ms_; }

 private:
  static constexpr int64_t kFrameNs = 33'333'333;

  static void count(const Place& place, const Frame& frame, const FrameResult& result, size_t i,
                    Outcome* outcome) {
    if (result.map != place.map->map) {
      ++outcome->wrong_map;
      return;
    }
    const SE3* exact = place.truth.at(frame.time);
    if (exact == nullptr) return;
    if (!compare(place.truth_from_map, result.camera_from_map, *exact).is_right(place.tolerance)) {
      ++outcome->wrong_pose;
    } else if (!outcome->published) {
      outcome->published = i;
    }
  }

  const std::map<std::string, Place>& places_;
  const PlaceIndex& index_;
  std::unique_ptr<Tracker> tracker_;
  MapSnapshotPtr held_;
  Timestamp time_;
  std::vector<double> answer_ms_;
};

void report(const std::vector<Outcome>& outcomes, const Player& player, const PlaceIndex& index) {
  std::vector<double> answered;
  std::vector<double> published;
  size_t wrong_map = 0;
  size_t wrong_pose = 0;
  for (const Outcome& o : outcomes) {
    if (o.answered) answered.push_back(static_cast<double>(*o.answered));
    if (o.published) published.push_back(static_cast<double>(*o.published));
    wrong_map += o.wrong_map;
    wrong_pose += o.wrong_pose;
  }
  std::printf(
      "maps %zu keyframes %zu; jumps %zu recovered %zu; frames to the first right and later proven pose p50 "
      "%.0f "
      "max %.0f, to the first published p50 %.0f max %.0f; frames in a wrong map %zu, with a wrong pose "
      "%zu\n",
      index.maps().size(), index.keyframe_count(), outcomes.size(), published.size(),
      percentile(answered, 0.5), percentile(answered, 1), percentile(published, 0.5),
      percentile(published, 1), wrong_map, wrong_pose);
  std::printf("questions %zu; answer p50 %.2f p95 %.2f ms\n", player.answer_ms().size(),
              percentile(player.answer_ms(), 0.5), percentile(player.answer_ms(), 0.95));
}

Status run(const Arguments& arguments) {
  if (arguments.places.size() % kPlaceFields != 0)
    return fail(ErrorCode::kUsage, "--place needs NAME SOURCE TRUTH FRAMES TOLERANCE");
  const auto jumps = read_jumps(arguments.jumps);
  if (!jumps) return tl::unexpected(jumps.error());
  std::map<std::string, Place> places;
  PlaceIndex index;
  uint8_t id = 1;
  for (size_t i = 0; i < arguments.places.size(); i += kPlaceFields) {
    const auto fields = std::span(arguments.places).subspan(i, kPlaceFields);
    auto place = make_place(fields, id++, *jumps, arguments.seed, &index);
    if (!place) return fail(place.error().code, fields[0] + ": " + place.error().message);
    places.emplace(fields[0], std::move(*place));
  }
  if (const Status done = map_others(arguments.others, id, arguments.seed, &index); !done) return done;
  Player player(places, index, arguments.seed);
  std::vector<Outcome> outcomes;
  for (const Jump& jump : *jumps) {
    const auto place = places.find(jump.place);
    if (place == places.end()) return fail(ErrorCode::kUsage, jump.place + ": no such --place");
    const Outcome& o = outcomes.emplace_back(player.play(place->second, jump.first_frame));
    if (!arguments.verbose) continue;
    const auto text = [](const std::optional<size_t>& frame) {
      return frame ? fmt::format("{}", *frame) : "-";
    };
    std::printf("%s %lu: right %s published %s wrong map %zu wrong pose %zu\n", jump.place.c_str(),
                static_cast<unsigned long>(jump.first_frame), text(o.answered).c_str(),
                text(o.published).c_str(), o.wrong_map, o.wrong_pose);
  }
  report(outcomes, player, index);
  return {};
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Maps of several recordings, then one tracker that jumps between them, without DDS");
  cairn::Arguments arguments;
  app.add_option("--place", arguments.places, "NAME SOURCE TRUTH FRAMES TOLERANCE, once for each recording")
      ->required();
  app.add_option("--also", arguments.others, "a recording of another place, mapped too; any number of times");
  app.add_option("--jumps", arguments.jumps, "rows `name first_frame`, in the order they are played")
      ->required();
  app.add_option("--seed", arguments.seed, "of every random choice");
  app.add_flag("-v,--verbose", arguments.verbose, "a line per jump");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    std::fprintf(stderr, "cairn-jump-run: %s\n", done.error().message.c_str());
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
