// SPDX-License-Identifier: Apache-2.0
//
// The relocalizer's first stage over 100 to 100 000 keyframes: linear scan beside forest. The images are
// drawn with the statistics of recorded ones.
#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <functional>
#include <limits>

#include "common/base/log.h"
#include "common/image/frame_images.h"
#include "server/relocalization/relocalizer.h"
#include "server/relocalization/test_images.h"
#include "tests/bench/image_statistics.h"
#include "tests/bench/json_file.h"
#include "tests/bench/recorded_map.h"
#include "tests/bench/timing.h"

namespace cairn {
namespace {

constexpr size_t kKeyframesOfMap = 20;
constexpr size_t kWanted = 10;     ///< recall@10
constexpr size_t kShortlist = 12;  ///< what the relocalizer asks for at first
constexpr size_t kFused = 128;     ///< and for the order that is fused with that of words

struct Arguments {
  std::vector<std::string> sources;
  std::vector<size_t> sizes = {100, 1000, 10'000, 100'000};
  std::string map;
  std::string json;
  size_t map_frames = 0;
  size_t every = 5;
  size_t apart = 20;
  size_t queries = 400;
  uint64_t seed = 1;
};

double us_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin).count();
}

/// An image as it comes with a query, and whether its place is mapped.
struct Query {
  TinyImage tiny;
  bool is_mapped = false;
};

/// A place that was recorded, and queries about it.
struct RecordedPlace {
  CameraPtr camera;
  IndexedMapPtr map;
  std::vector<PlaceView> views;
};

Result<RecordedPlace> record_place(const std::string& uri, size_t map_frames, size_t views) {
  auto source = open_aloud(uri);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(**source, uri, "");
  if (!camera) return tl::unexpected(camera.error());
  auto recorded = map_beginning(source->get(), map_frames, *camera,
                                testing::map_id(std::numeric_limits<uint32_t>::max()), 1);
  if (!recorded) return tl::unexpected(recorded.error());
  RecordedPlace place{*camera, std::move(recorded->map), {}};
  const size_t frames = (*source)->frame_count().value_or(map_frames + views);
  if (frames <= map_frames)
    return fail(ErrorCode::kUsage,
                fmt::format("{}: the map takes all its {} frames, none is left to ask about", uri, frames));
  const size_t step = std::max<size_t>(1, (frames - map_frames) / std::max<size_t>(1, views));
  FrameImages images;
  for (;;) {
    const auto next = (*source)->next();
    if (!next) continue;
    if (!*next) return place;
    if ((*next)->index % step != 0) continue;
    images.build_pyramid((*next)->image->view());
    place.views.push_back(describe_place(images.pyramid, images.all_corners()));
  }
}

/// Maps of kKeyframesOfMap images each, as many as are asked for, and queries about them.
class World {
 public:
  /// `recorded`: null, or a place that is mapped besides, whose words those of the others are made of.
  World(const ImageStatistics& statistics, const RecordedPlace* recorded, uint64_t seed)
      : statistics_(statistics), recorded_(recorded), random_(seed) {
    if (recorded_ != nullptr) index.put(recorded_->map);
  }

  void grow_to(size_t keyframes) {
    while (index.keyframe_count() < keyframes) {
      places_.push_back(statistics_.draw_place(&random_));
      std::vector<TinyImage> images;
      std::vector<std::vector<WordId>> words;
      const auto renaming = static_cast<size_t>(random_() % kVocabularyWords);
      for (size_t i = 0; i < kKeyframesOfMap; ++i) {
        images.push_back(statistics_.draw_image(places_.back(), &random_));
        words.push_back(draw_words(renaming));
      }
      index.put(testing::image_map(testing::map_id(static_cast<uint32_t>(places_.size())), std::move(images),
                                   std::move(words)));
    }
  }
  /// Draws queries, every second one of a place that is mapped.
  std::vector<Query> ask(size_t count) {
    std::vector<Query> queries;
    for (size_t i = 0; i < count; ++i) {
      const bool is_mapped = i % 2 == 0;
      const Eigen::VectorXf place =
          is_mapped ? places_[random_() % places_.size()] : statistics_.draw_place(&random_);
      queries.push_back({statistics_.draw_image(place, &random_), is_mapped});
    }
    return queries;
  }

  PlaceIndex index;

 private:
  /// Draws words: as many as a recorded keyframe has and as scattered over cells, but others in each map.
  std::vector<WordId> draw_words(size_t renaming) {
    if (recorded_ == nullptr) return {};
    const auto& keyframes = recorded_->map->keyframes;
    std::vector<WordId> words = keyframes[random_() % keyframes.size()]->words;
    for (WordId& word : words) word = static_cast<WordId>((word + renaming) % kVocabularyWords);
    std::sort(words.begin(), words.end());
    return words;
  }

  const ImageStatistics& statistics_;
  const RecordedPlace* recorded_;
  std::mt19937_64 random_;
  std::vector<Eigen::VectorXf> places_;
};

/// Every tiny image compared.
std::vector<Ranked> compare_all(const PlaceIndex& index, const QueryImage& query, size_t count) {
  std::vector<Ranked> ranked;
  ranked.reserve(index.keyframe_count());
  for (const IndexedMapPtr& map : index.maps()) {
    for (size_t k = 0; k < map->keyframes.size(); ++k)
      ranked.push_back({dissimilarity(*map->keyframes[k], query), map.get(), k});
  }
  const auto end = ranked.begin() + static_cast<ptrdiff_t>(std::min(count, ranked.size()));
  std::partial_sort(ranked.begin(), end, ranked.end(),
                    [](const Ranked& a, const Ranked& b) { return a.cost < b.cost; });
  ranked.erase(end, ranked.end());
  return ranked;
}

using Search = std::function<std::vector<Ranked>(const QueryImage& query)>;

struct Measured {
  std::vector<double> us;
  size_t wanted_mapped = 0, found_mapped = 0, wanted_else = 0, found_else = 0;
};

Measured measure(const std::vector<Query>& queries, const std::vector<std::vector<Ranked>>& exact,
                 size_t most, const Search& search) {
  Measured measured;
  for (size_t q = 0; q < queries.size(); ++q) {
    TinyImage tiny = queries[q].tiny;
    const auto begin = std::chrono::steady_clock::now();
    const std::vector<Ranked> found = search(QueryImage(std::move(tiny)));
    measured.us.push_back(us_since(begin));
    const size_t wanted = std::min(most, exact[q].size());
    const auto first = std::count_if(
        exact[q].begin(), exact[q].begin() + static_cast<ptrdiff_t>(wanted), [&](const Ranked& e) {
          return std::any_of(found.begin(), found.end(),
                             [&](const Ranked& f) { return f.map == e.map && f.keyframe == e.keyframe; });
        });
    (queries[q].is_mapped ? measured.wanted_mapped : measured.wanted_else) += wanted;
    (queries[q].is_mapped ? measured.found_mapped : measured.found_else) += static_cast<size_t>(first);
  }
  return measured;
}

/// Prints a row of results, and returns it as JSON.
nlohmann::json report(size_t keyframes, const char* what, const Measured& m, const std::string& note) {
  const double recall_mapped = static_cast<double>(m.found_mapped) / static_cast<double>(m.wanted_mapped);
  const double recall_elsewhere = static_cast<double>(m.found_else) / static_cast<double>(m.wanted_else);
  std::printf("| %zu | %s | %.0f / %.0f | %.3f, %.3f | %s |\n", keyframes, what, percentile(m.us, 0.5),
              percentile(m.us, 0.95), recall_mapped, recall_elsewhere, note.c_str());
  std::fflush(stdout);
  return {{"keyframes", keyframes},          {"search", what},
          {"us_p50", percentile(m.us, 0.5)}, {"us_p95", percentile(m.us, 0.95)},
          {"recall_mapped", recall_mapped},  {"recall_elsewhere", recall_elsewhere}};
}

/// What a new keyframe costs before it can be found: a version of the index with that map changed.
double time_change(const PlaceIndex& index) {
  constexpr int kTimes = 20;
  std::vector<double> us;
  for (int i = 0; i < kTimes; ++i) {
    const IndexedMapPtr map = index.maps()[static_cast<size_t>(i) * index.maps().size() / kTimes];
    const auto begin = std::chrono::steady_clock::now();
    PlaceIndex next = index;
    next.put(map);
    us.push_back(us_since(begin));
  }
  return percentile(us, 0.95);
}

/// Whole queries about the recorded place; what was printed.
nlohmann::json time_answers(const PlaceIndex& index, const RecordedPlace& place, const char* what) {
  std::vector<double> by_images;  // [ms]
  std::vector<double> with_words;
  size_t right = 0;
  for (const PlaceView& view : place.views) {
    const auto begin = std::chrono::steady_clock::now();
    const RelocalizationAnswer answer = relocalize(index, *place.camera, view, RelocOptions());
    const double ms = 1e-3 * us_since(begin);
    const bool is_early = answer.candidates.size() <= static_cast<size_t>(RelocOptions().by_image_alone);
    (is_early ? by_images : with_words).push_back(ms);
    if (answer.verdict == RelocalizationVerdict::kConfirmed &&
        answer.candidates.front().map == place.map->snapshot->map)
      ++right;
  }
  std::printf("| %zu | %s | %zu of %zu | %zu: %.1f / %.1f | %zu: %.1f / %.1f |\n", index.keyframe_count(),
              what, right, place.views.size(), by_images.size(), percentile(by_images, 0.5),
              percentile(by_images, 0.95), with_words.size(), percentile(with_words, 0.5),
              percentile(with_words, 0.95));
  std::fflush(stdout);
  return {{"search", what},
          {"right", right},
          {"asked", place.views.size()},
          {"by_images", spread_json(by_images)},
          {"with_words", spread_json(with_words)}};
}

void run_answers(World* world, const RecordedPlace& place, size_t keyframes, nlohmann::json* figures) {
  world->grow_to(keyframes);
  const auto time = [&](const char* what) {
    nlohmann::json row = time_answers(world->index, place, what);
    row["keyframes"] = keyframes;
    figures->push_back(std::move(row));
  };
  time("queries by the scan");
  world->index.set_forest(plant_forest(world->index, 0, ForestOptions()));
  time("queries by the forest");
  world->index.set_forest(nullptr);
}

void run_size(World* world, size_t keyframes, size_t count, nlohmann::json* figures) {
  world->grow_to(keyframes);
  const std::vector<Query> queries = world->ask(count);
  std::vector<std::vector<Ranked>> exact;
  for (const Query& q : queries) exact.push_back(compare_all(world->index, QueryImage(q.tiny), kFused));
  PlaceIndex& index = world->index;
  const auto look = [&](size_t wanted, size_t most, ImageSearch search) {
    return measure(queries, exact, wanted, [&, most, search](const QueryImage& query) {
      return NearImages(index, query, search).most_similar(most);
    });
  };
  const auto tell = [&](const char* what, const Measured& measured, const std::string& note) {
    figures->push_back(report(keyframes, what, measured, note));
  };
  tell("all tiny images",
       measure(queries, exact, kWanted,
               [&](const auto& query) { return compare_all(index, query, kShortlist); }),
       fmt::format("change {:.0f} us", time_change(index)));
  tell("scan of compact images", look(kWanted, kShortlist, ImageSearch::kScan),
       fmt::format("{:.1f} MB", static_cast<double>(keyframes * sizeof(CompactImage)) * 1e-6));
  tell("scan, for the fused order", look(kFused, kFused, ImageSearch::kScan), "");
  const auto begin = std::chrono::steady_clock::now();
  ImageForestPtr forest = plant_forest(index, 0, ForestOptions());
  const double planted_us = us_since(begin);
  const size_t bytes = forest->bytes();
  const auto adopted = std::chrono::steady_clock::now();
  index.set_forest(std::move(forest));
  const double adopted_us = us_since(adopted);
  tell("forest", look(kWanted, kShortlist, ImageSearch::kForest),
       fmt::format("planted in {:.0f} ms, {:.1f} MB; adopted in {:.1f} ms; change {:.0f} us",
                   planted_us * 1e-3, static_cast<double>(bytes) * 1e-6, adopted_us * 1e-3,
                   time_change(index)));
  tell("forest, for the fused order", look(kFused, kFused, ImageSearch::kForest), "");
  index.set_forest(nullptr);
}

Status run(const Arguments& arguments) {
  const auto statistics = ImageStatistics::measure(arguments.sources, arguments.every, arguments.apart);
  if (!statistics) return tl::unexpected(statistics.error());
  std::printf("%zu images; %zu dimensions hold 0.999 of the variance; %.2f of it is within a place\n",
              statistics->frames(), statistics->dimensions(), statistics->share_within());
  std::printf(
      "| keyframes | search | us p50 / p95 | recall@%zu (fused order: @%zu): mapped place, elsewhere | "
      "|\n|---|---|---|---|---|\n",
      kWanted, kFused);
  nlohmann::json figures = {{"searches", nlohmann::json::array()}, {"answers", nlohmann::json::array()}};
  {
    World world(*statistics, nullptr, arguments.seed);
    for (const size_t keyframes : arguments.sizes)
      run_size(&world, keyframes, arguments.queries, &figures["searches"]);
  }
  if (arguments.map.empty()) return write_figures(arguments.json, figures);
  const auto recorded = record_place(arguments.map, arguments.map_frames, arguments.queries);
  if (!recorded) return tl::unexpected(recorded.error());
  std::printf(
      "| keyframes | search | confirmed in their map | by images: ms p50 / p95 | with words |\n"
      "|---|---|---|---|---|\n");
  World world(*statistics, &*recorded, arguments.seed);
  for (const size_t keyframes : arguments.sizes)
    run_answers(&world, *recorded, keyframes, &figures["answers"]);
  return write_figures(arguments.json, figures);
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  CLI::App app("Finding the most alike of many keyframes: linear scan beside forest");
  cairn::Arguments arguments;
  app.add_option("--source", arguments.sources, "recordings of 640x480 whose statistics the images have")
      ->required();
  app.add_option("--every", arguments.every, "of their frames is looked at")->check(CLI::PositiveNumber);
  app.add_option("--apart", arguments.apart, "frames between two images of one place")
      ->check(CLI::PositiveNumber);
  app.add_option("--map", arguments.map, "a recording: whole queries about its place are timed, too");
  app.add_option("--map-frames", arguments.map_frames,
                 "frames that its map is made of; the others are asked about");
  app.add_option("--json", arguments.json, "write the figures here, for write-figures")->type_name("FILE");
  app.add_option("--keyframes", arguments.sizes, "ascending");
  app.add_option("--queries", arguments.queries, "for each number of keyframes");
  app.add_option("--seed", arguments.seed, "of the images");
  CLI11_PARSE(app, argc, argv);
  if (const auto done = cairn::run(arguments); !done) {
    cairn::say_error("cairn-index-bench", done.error().message);
    return cairn::exit_code(done.error().code);
  }
  return 0;
}
