// SPDX-License-Identifier: Apache-2.0
//
// Many recordings as separate maps in one index, and images of each that were not mapped: which map, and
// where? Asked again under other light, of an index that lacks the place's own map (whatever is answered then
// is wrong), and of the baselines. Without DDS.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/program_folder.h"
#include "common/image/frame_images.h"
#include "server/relocalization/confirm.h"
#include "server/relocalization/relocalizer.h"
#include "server/relocalization/votes.h"
#include "tests/bench/answer_times.h"
#include "tests/bench/json_file.h"
#include "tests/bench/light.h"
#include "tests/bench/mapped_places.h"
#include "tests/bench/recall.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

struct Arguments {
  PlacesOptions places;
  std::string json;
  bool ours_alone = false;
  bool check = false;
  bool check_times = false;
  bool verbose = false;
  double tolerance = 10;  ///< % of the depth
};

enum class Method : uint8_t { kOurs, kPaper, kWords, kWordsConfirmed, kCount };
constexpr size_t kMethods = static_cast<size_t>(Method::kCount);
constexpr std::array<const char*, kMethods> kMethodNames = {"ours", "paper", "words", "words+geometry"};

/// An answer: a pose near a keyframe of a map.
struct Said {
  MapId map;
  KeyframeId keyframe;
  SE3 camera_from_keyframe;
};
struct Answered {
  std::optional<Said> said;  ///< nothing: not known
  size_t tried = 0;          ///< keyframes
};

Answered ask_relocalizer(const PlaceIndex& index, const Camera& camera, const PlaceView& view,
                         RelocMethod method) {
  RelocOptions options;
  options.method = method;
  const RelocalizationAnswer answer = relocalize(index, camera, view, options);
  if (answer.verdict == RelocalizationVerdict::kNotKnown) return {std::nullopt, answer.candidates.size()};
  const PlaceCandidate& best = answer.candidates.front();
  return {Said{best.map, best.keyframe, best.camera_from_keyframe}, answer.candidates.size()};
}

/// Voted for by the words alone: every map may be it.
std::vector<Voted> vote_everywhere(const PlaceIndex& index, const PlaceView& view,
                                   std::span<const CellList> cells, size_t count) {
  std::vector<const IndexedMap*> maps;
  for (const IndexedMapPtr& map : index.maps()) maps.push_back(map.get());
  return vote(index, maps, view, cells, count, VoteOptions());
}

/// The keyframe with the most votes of the words: always an answer, at that keyframe's own pose. 10 240
/// words, learned from made images.
std::optional<Said> ask_words(const PlaceIndex& index, const PlaceView& view) {
  const auto voted = vote_everywhere(index, view, probed_cells(view), 1);
  if (voted.empty()) return std::nullopt;
  const IndexedMap& map = *voted.front().map;
  return Said{map.snapshot->map, map.keyframes[voted.front().keyframe]->id, SE3()};
}

/// The first keyframe in the order of votes that geometry confirms, of as many as ours may try.
std::optional<Said> ask_words_confirmed(const PlaceIndex& index, const Camera& camera,
                                        const PlaceView& view) {
  const RelocOptions options;
  const auto cells = probed_cells(view);
  const CornerGrid grid(view, camera);
  for (const Voted& v : vote_everywhere(index, view, cells, static_cast<size_t>(options.shortlist))) {
    const Confirmation said =
        confirm(view, cells, grid, camera, *v.map, v.keyframe,
                run_prefilter(view, cells, *v.map, v.keyframe, options.confirm.match), options.confirm);
    if (!said.confirmed) continue;
    const KeyframePose* k = v.map->snapshot->find(v.map->keyframes[v.keyframe]->id);
    return Said{v.map->snapshot->map, k->id, *said.camera_from_map * k->camera_from_map.inverse()};
  }
  return std::nullopt;
}

Answered ask(Method method, const PlaceIndex& index, const Camera& camera, const PlaceView& view) {
  switch (method) {
    case Method::kOurs:
      return ask_relocalizer(index, camera, view, RelocMethod::kImproved);
    case Method::kPaper:
      return ask_relocalizer(index, camera, view, RelocMethod::kPaper);
    case Method::kWords:
      return {ask_words(index, view)};
    default:
      return {ask_words_confirmed(index, camera, view)};
  }
}

Judged judge(const Place& place, const Query& query, const std::optional<Said>& said, double tolerance) {
  Judged judged;
  judged.tolerance = tolerance;
  judged.in_view = place.map && !place.asks_elsewhere &&
                   (!query.exact || overlaps_a_view(*query.exact, place.mapped, place.reach));
  judged.answered = said.has_value();
  judged.right_map = said && place.map && said->map == place.map->snapshot->map;
  judged.depth = place.depth;
  if (judged.right_map && query.exact) {
    const SE3 pose = said->camera_from_keyframe * place.map->snapshot->find(said->keyframe)->camera_from_map;
    judged.off = compare(place.truth_from_map, pose, *query.exact);
  }
  return judged;
}

/// Result of one method under one light.
struct Score {
  Recall recall;       ///< with all maps
  size_t foreign = 0;  ///< queries to an index without the place's own map
  size_t claimed = 0;  ///< of these, answered
  AnswerTimes times;   ///< with all maps

  void add(const Score& other) {
    recall.add(other.recall);
    foreign += other.foreign;
    claimed += other.claimed;
    times.add(other.times);
  }
};
using Scores = std::array<Score, kMethods>;

class Examination {
 public:
  Examination(const std::vector<Place>& places, const Arguments& a)
      : places_(places), verbose_(a.verbose), ours_alone_(a.ours_alone), tolerance_(a.tolerance / 100) {
    for (const Place& place : places) {
      if (place.map) all_.put(place.map);
    }
  }

  [[nodiscard]] Scores examine(const Place& place, const Light& light) const {
    PlaceIndex others = all_;
    if (place.map) others.remove(place.map->snapshot->map);
    Scores scores;
    for (const Query& query : place.queries) {
      FrameImages images;
      images.build_pyramid(relight(*query.image, light).view());
      const PlaceView view = describe_place(images.pyramid, images.all_corners());
      for (size_t m = 0; m < (ours_alone_ ? 1 : kMethods); ++m) {
        const auto method = static_cast<Method>(m);
        const double before = thread_cpu_ms();
        const Answered answer = ask(method, all_, *place.camera, view);
        scores[m].times.add(answer.tried, thread_cpu_ms() - before);
        const Judged judged = judge(place, query, answer.said, tolerance_);
        scores[m].recall.add(judged);
        const auto claim = place.map ? ask(method, others, *place.camera, view).said : answer.said;
        ++scores[m].foreign;
        scores[m].claimed += claim ? 1 : 0;
        if (method == Method::kOurs && verbose_) tell(place, light, query, judged, claim, view);
      }
    }
    return scores;
  }
  [[nodiscard]] const PlaceIndex& index() const { return all_; }

 private:
  [[nodiscard]] std::string name_of(const MapId& map) const {
    for (const Place& place : places_) {
      if (place.map && place.map->snapshot->map == map) return place.name;
    }
    return "?";
  }

  /// Prints what went wrong with a query.
  void tell(const Place& place, const Light& light, const Query& query, const Judged& judged,
            const std::optional<Said>& claim, const PlaceView& view) const {
    const auto say = [&](const std::string& what) {
      std::printf("%s %lu, %s: %s\n", place.name.c_str(), static_cast<unsigned long>(query.frame),
                  to_string(light).c_str(), what.c_str());
    };
    if (claim) say("claimed to be in " + name_of(claim->map));
    if (judged.answered && place.map && !judged.right_map) say("WRONG MAP");
    if (judged.off && !is_right_pose(judged))
      say(fmt::format("WRONG POSE {:.3f} of depth {:.3f}, {:.1f} deg", judged.off->metres, judged.depth,
                      judged.off->degrees));
    if (judged.answered || !judged.in_view) return;
    say("not found; " + find_cause(place, view));
  }

  /// Says where a query about a mapped place is lost: the keyframe of its own map that geometry likes best,
  /// the rank it has by its image and by words, and what geometry says of it.
  [[nodiscard]] std::string find_cause(const Place& place, const PlaceView& view) const {
    const IndexedMap& map = *place.map;
    const RelocOptions options;
    const auto cells = probed_cells(view);
    const CornerGrid grid(view, *place.camera);
    size_t best = 0;
    Confirmation most;
    const auto merit = [](const Confirmation& c) {
      return std::tuple(c.confirmed, c.inliers, c.agreeing, c.supported);
    };
    for (size_t k = 0; k < map.keyframes.size(); ++k) {
      const Confirmation said =
          confirm(view, cells, grid, *place.camera, map, k,
                  run_prefilter(view, cells, map, k, options.confirm.match), options.confirm);
      if (k > 0 && merit(said) <= merit(most)) continue;
      most = said;
      best = k;
    }
    const auto rank = [&](const auto& ranked) {
      const auto at = std::find_if(ranked.begin(), ranked.end(),
                                   [&](const auto& r) { return r.map == &map && r.keyframe == best; });
      return at - ranked.begin() + 1;
    };
    const QueryImage query(TinyImage(view.small, kPlaceBlur));
    const size_t all = all_.keyframe_count();
    return fmt::format(
        "{} corners; rank {} by image, {} by words; {} matches, {} supported, {} agree, {} of {} "
        "met, {} of {} expected, alike {:.2f}, order {:.2f}, unity {:.2f}, evidence {:.2f}: {}",
        view.corners.size(), rank(NearImages(all_, query, ImageSearch::kScan, all).most_similar(all)),
        rank(vote_everywhere(all_, view, cells, all)), most.matches, most.supported, most.agreeing,
        most.inliers, most.met, most.inliers, most.expected, most.similarity, most.order, unity(most),
        evidence(most), most.confirmed ? "confirmed" : most.reason);
  }

  const std::vector<Place>& places_;
  bool verbose_;
  bool ours_alone_;
  double tolerance_;  ///< of the depth
  PlaceIndex all_;
};

double percent(size_t part, size_t whole) {
  return whole == 0 ? 0 : 100.0 * static_cast<double>(part) / static_cast<double>(whole);
}

/// `-` where there is nothing of which to say it.
std::string percent_text(double share, bool is_known) {
  return is_known ? fmt::format("{:.1f}%", 100 * share) : "-";
}
std::string off_text(const Recall& recall, double p) {
  return recall.off.empty() ? "-" : fmt::format("{:.2f}", 100 * percentile(recall.off, p));
}

void print_place(const Place& place, const Score& s) {
  const Recall& r = s.recall;
  std::printf(
      "%-22s %-14s %5zu | %4zu %4zu %6s | %4zu %4zu | %4zu %4zu | %4zu %4zu | %5s %5s | %5.1f %5.1f\n",
      place.name.c_str(), place.how.c_str(), place.map ? place.map->keyframes.size() : 0, r.in_view, r.right,
      percent_text(r.share(), r.in_view > 0).c_str(), r.elsewhere, r.answered_else, r.wrong_map, r.wrong_pose,
      s.foreign, s.claimed, off_text(r, 0.5).c_str(), off_text(r, 0.95).c_str(),
      percentile(s.times.all(), 0.5), percentile(s.times.all(), 0.95));
}

void print_total(const char* method, const std::string& light, const Score& s) {
  const Recall& r = s.recall;
  std::printf("%-15s %-12s | %4zu %4zu %5.1f%% | %4zu %4zu | %4zu %5.1f%% | %4zu | %4zu %4zu | %5.1f %5.1f\n",
              method, light.c_str(), r.in_view, r.right, 100 * r.share(), r.elsewhere, r.answered_else,
              r.wrong_map, percent(r.wrong_map, r.in_view + r.elsewhere), r.wrong_pose, s.foreign, s.claimed,
              percentile(s.times.all(), 0.5), percentile(s.times.all(), 0.95));
}

/// The figures of print_total() as JSON.
nlohmann::json total_json(const char* method, const std::string& light, const Score& s) {
  const Recall& r = s.recall;
  return {{"method", method},
          {"light", light},
          {"in_view", r.in_view},
          {"right", r.right},
          {"elsewhere", r.elsewhere},
          {"answered_elsewhere", r.answered_else},
          {"wrong_map", r.wrong_map},
          {"wrong_pose", r.wrong_pose},
          {"foreign", s.foreign},
          {"claimed", s.claimed},
          {"by_images", spread_json(s.times.by_image())},
          {"with_words", spread_json(s.times.by_words())}};
}

/// Says what must hold of our answers and does not, a line each.
std::vector<std::string> complaints(const std::vector<Scores>& totals) {
  constexpr double kLeastRecall = 0.95;
  std::vector<std::string> found;
  for (size_t l = 0; l < totals.size(); ++l) {
    const Score& ours = totals[l][0];
    const std::string light = to_string(lights_to_stand()[l]);
    if (ours.recall.wrong_map + ours.recall.wrong_pose + ours.claimed > 0)
      found.push_back(fmt::format("{}: {} in a wrong map, {} wrong poses, {} claimed without the own map",
                                  light, ours.recall.wrong_map, ours.recall.wrong_pose, ours.claimed));
    if (ours.recall.share() < kLeastRecall)
      found.push_back(fmt::format("{}: {:.1f} % right", light, 100 * ours.recall.share()));
  }
  return found;
}

AnswerTimes times_in_all_lights(const std::vector<Scores>& totals) {
  AnswerTimes times;
  for (const Scores& total : totals) times.add(total[0].times);
  return times;
}

/// They depend on the machine and on what else it does.
bool are_quick(const AnswerTimes& times) {
  constexpr double kMostByImage = 5;  // [ms]
  constexpr double kMostWithWords = 15;
  return percentile(times.by_image(), 0.95) <= kMostByImage &&
         percentile(times.by_words(), 0.95) <= kMostWithWords;
}

/// Judges a run: an error names what is left out, and with --check what does not hold.
Status judge_run(const Places& places, const std::vector<Scores>& totals, const Arguments& arguments) {
  std::vector<std::string> wrong;
  if (!places.left_out.empty())
    wrong.push_back(fmt::format(
        "left out: {}; put these recordings into {}, or pass --places FILE with a list without them",
        fmt::join(places.left_out, ", "), arguments.places.recordings.string()));
  if (arguments.check) {
    for (const std::string& complaint : complaints(totals)) wrong.push_back("does not hold: " + complaint);
  }
  const AnswerTimes times = times_in_all_lights(totals);
  if (arguments.check_times && !are_quick(times)) wrong.push_back("does not hold: " + times.text());
  if (wrong.empty()) return {};
  return fail(ErrorCode::kDegenerate, fmt::format("{}", fmt::join(wrong, "; ")));
}

Status examine_places(const Arguments& arguments) {
  const auto places = make_places(arguments.places);
  if (!places) return tl::unexpected(places.error());
  const Examination examination(places->made, arguments);
  std::printf("maps %zu keyframes %zu\n", examination.index().maps().size(),
              examination.index().keyframe_count());
  std::printf(
      "as recorded, ours\n%-22s %-14s %5s | in view, right | elsewhere, answered | wrong map, pose | "
      "own map taken away: asked, claimed | off [%% of depth] p50 p95 | ms p50 p95\n",
      "place", "mapped from", "keyfr");
  std::vector<Scores> totals;
  for (const Light& light : lights_to_stand()) {
    Scores& total = totals.emplace_back();
    std::fprintf(stderr, "asking, %s\n", to_string(light).c_str());
    for (const Place& place : places->made) {
      const Scores scores = examination.examine(place, light);
      if (totals.size() == 1 || arguments.verbose) print_place(place, scores[0]);
      std::fflush(stdout);
      for (size_t m = 0; m < kMethods; ++m) total[m].add(scores[m]);
    }
  }
  std::printf(
      "%-15s %-12s | in view, right | elsewhere, answered | wrong map, of all | wrong pose | "
      "own map taken away: asked, claimed | ms p50 p95\n",
      "method", "light");
  nlohmann::json lights = nlohmann::json::array();
  for (size_t m = 0; m < (arguments.ours_alone ? 1 : kMethods); ++m) {
    for (size_t l = 0; l < totals.size(); ++l) {
      const std::string light = to_string(lights_to_stand()[l]);
      print_total(kMethodNames[m], light, totals[l][m]);
      lights.push_back(total_json(kMethodNames[m], light, totals[l][m]));
    }
  }
  std::printf("ours, as recorded: %s\nours, all lights: %s\n", totals[0][0].times.text().c_str(),
              times_in_all_lights(totals).text().c_str());
  for (const Place& place : places->made) {
    if (place.asks_elsewhere)
      std::printf("%s: declared in the list not to show what is mapped, and so never in view\n",
                  place.name.c_str());
  }
  const nlohmann::json figures = {{"lights", std::move(lights)}};
  if (Status done = write_figures(arguments.json, figures); !done) return done;
  return judge_run(*places, totals, arguments);
}

constexpr const char* kFooter =
    R"(DATA_DIR/FOLDER holds rgb.txt, or video.mp4 and times.txt. The rows of the list of places, `-` where there is
nothing to say:
  video    FOLDER CAMERA TRUTH UNIT FRAMES   mapped from its first FRAMES by tracker and map maker
  stills   FOLDER CAMERA TRUTH UNIT          every other one is mapped, from its given pose
  unmapped FOLDER CAMERA                     asked about only
CAMERA: a calibration in that folder or beside the list, by default its camera.txt; TRUTH: a trajectory in that
folder, or `elsewhere`: none, and what is asked about does not show what is mapped; UNIT: m, or - if unknown.
Exit codes: 0 ok, 1 a place is left out, or a check finds fault, 2 usage, 3 list or recordings missing.)";

void add_options(CLI::App& app, Arguments* arguments) {
  app.add_option("DATA_DIR", arguments->places.recordings, "folder of the recordings")
      ->envname("CAIRN_DATA")
      ->required();
  app.add_option("--places", arguments->places.list, "list of places, below")
      ->type_name("FILE")
      ->capture_default_str();
  app.add_option("--keep", arguments->places.keep,
                 "a map found there by its name is not made again, whatever seed or frames it was made with; "
                 "what is made is kept there")
      ->type_name("FOLDER");
  app.add_flag("--ours", arguments->ours_alone, "no baselines");
  app.add_option("--json", arguments->json, "write the figures here, for write-figures")->type_name("FILE");
  app.add_option("--seed", arguments->places.seed, "of every random choice")
      ->type_name("NUMBER")
      ->capture_default_str();
  app.add_flag(
      "--check", arguments->check,
      "ends with 1 unless ours has no wrong map, no wrong pose and no claim without the own map, and 95 % "
      "right in every light");
  app.add_flag("--check-times", arguments->check_times,
               "ends with 1 unless ours answers within 5 ms of CPU by images and 15 with words (p95)");
  app.add_option("--tolerance", arguments->tolerance, "of a right pose, in % of the depth")
      ->check(CLI::Range(0.0, 100.0))
      ->type_name("PERCENT")
      ->capture_default_str();
  app.add_flag("-v,--verbose", arguments->verbose, "a line for each of our mistakes");
  app.footer(kFooter);
}

/// The list that is built, and installed, with the program.
std::filesystem::path list_of_program() {
  return program_folder().parent_path() / "share/cairn/places.txt";
}

int run(int argc, char** argv) {
  const std::string name = std::filesystem::path(argv[0]).filename();  // cairn-eval has its own for it
  const auto complain = [&](const std::string& what) {
    std::fprintf(stderr, "%s: %s\n", name.c_str(), what.c_str());
  };
  Arguments arguments;
  arguments.places.list = list_of_program();
  CLI::App app(
      "Recordings as separate maps, and images of them that were not mapped: which map, and from where? Also "
      "in other light, without the place's own map, and by the paper's method and by words.",
      name);
  add_options(app, &arguments);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    complain(std::string(error.what()) + "; see --help");
    return exit_code(ErrorCode::kUsage);
  }
  const Status done = examine_places(arguments);
  if (done) return 0;
  complain(done.error().message);
  return exit_code(done.error().code);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  return cairn::run(argc, argv);
}
