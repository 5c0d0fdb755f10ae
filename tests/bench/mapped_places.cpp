// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/mapped_places.h"

#include <fmt/format.h>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <utility>

#include "client/capture/frame_source.h"
#include "common/io/text.h"
#include "common/io/trajectory.h"
#include "tests/bench/kept_map.h"
#include "tests/bench/posed_map.h"
#include "tests/bench/recorded_map.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostQueries = 50;  // of one recording
constexpr double kReach = 0.25;      // [m], or of the depth where the truth has no unit

MapId map_id(size_t number) {
  MapId id;
  id.bytes[0] = static_cast<uint8_t>(number + 1);
  id.bytes[1] = static_cast<uint8_t>((number + 1) >> 8);
  return id;
}

/// A source, its camera and its truth, if any.
struct Recording {
  std::unique_ptr<FrameSource> source;
  CameraPtr camera;
  Truth truth;
};

Result<Recording> open_recording(const ListedPlace& listed, const PlacesOptions& options) {
  const auto files = find_files(listed, options.recordings, fs::absolute(options.list).parent_path());
  if (!files) return tl::unexpected(files.error());
  auto source = open_aloud(files->source);
  if (!source) return tl::unexpected(source.error());
  const auto camera = choose_camera(**source, files->source, files->camera);
  if (!camera) return tl::unexpected(camera.error());
  Recording recording{std::move(*source), *camera, {}};
  if (files->truth.empty()) return recording;
  const auto exact = read_trajectory(files->truth);
  if (!exact) return tl::unexpected(exact.error());
  recording.truth = Truth(*exact);
  return recording;
}

/// Reads all frames that are left. A frame that cannot be decoded is passed over.
std::vector<Frame> read_all(FrameSource* source) {
  std::vector<Frame> frames;
  for (auto next = source->next(); !next || *next; next = source->next()) {
    if (next) frames.push_back(**next);
  }
  return frames;
}

/// Chooses queries evenly spread over the frames; where there is truth, over those that have it.
std::vector<Query> choose_queries(const std::vector<Frame>& frames, const Truth& truth) {
  std::vector<Query> all;
  for (const Frame& frame : frames) {
    const SE3* exact = truth.at(frame.time);
    if (exact == nullptr && !truth.empty()) continue;
    all.push_back({frame.index, frame.image, exact != nullptr ? std::optional(*exact) : std::nullopt});
  }
  const size_t step = (all.size() + kMostQueries - 1) / kMostQueries;
  std::vector<Query> chosen;
  for (size_t i = 0; i < all.size(); i += step) chosen.push_back(std::move(all[i]));
  return chosen;
}

/// Puts into `place` what the truth says of the map.
Status measure_map(const std::vector<StampedPose>& poses, const Truth& truth, bool is_metric, Place* place) {
  if (truth.empty()) return {};
  const auto aligned = align(poses, truth);
  if (!aligned) return tl::unexpected(aligned.error());
  place->truth_from_map = *aligned;
  double sum = 0;
  for (const IndexedKeyframePtr& k : place->map->keyframes)
    sum += static_cast<double>(place->map->snapshot->find(k->id)->mean_depth);
  place->depth = aligned->scale() * sum / static_cast<double>(place->map->keyframes.size());
  place->reach = is_metric ? kReach : kReach * place->depth;
  for (const StampedPose& p : poses) {
    if (const SE3* exact = truth.at(p.time)) place->mapped.push_back(*exact);
  }
  return {};
}

/// The map kept by that name; where there is none, what `make` gives, which is kept from now on. `pass` does
/// instead of making what else that does.
template <typename Make, typename Pass>
Result<KeptMap> read_or_make(const fs::path& folder, const std::string& name, MapId id, const Make& make,
                             const Pass& pass) {
  if (!folder.empty()) {
    auto kept = read_kept_map(folder, name, id);
    if (kept) pass();
    if (kept || kept.error().code != ErrorCode::kNotFound) return kept;
  }
  auto made = make();
  if (!made) return tl::unexpected(made.error());
  if (!folder.empty()) {
    if (const Status done = keep_map(folder, name, id, made->record, made->poses); !done)
      return tl::unexpected(done.error());
  }
  return KeptMap{made->map, std::move(made->poses)};
}

/// Without queries yet.
Result<Place> place_of(const Result<KeptMap>& mapped, const ListedPlace& listed, std::string how,
                       const Recording& recording) {
  if (!mapped) return tl::unexpected(mapped.error());
  Place place{.name = listed.name, .how = std::move(how), .camera = recording.camera, .map = mapped->map};
  place.asks_elsewhere = listed.asks_elsewhere;
  const Status done = measure_map(mapped->poses, recording.truth, listed.is_metric, &place);
  if (!done) return tl::unexpected(done.error());
  return place;
}

Result<Place> make_video(const ListedPlace& listed, Recording* recording, MapId id,
                         const PlacesOptions& options) {
  FrameSource* source = recording->source.get();
  const size_t frames = listed.mapped_frames;
  const auto mapped = read_or_make(
      options.keep, listed.name, id,
      [&] { return map_beginning(source, frames, recording->camera, id, options.seed); },
      [&] {
        for (size_t i = 0; i < frames; ++i) static_cast<void>(source->next());
      });
  auto place = place_of(mapped, listed, "video", *recording);
  if (place) place->queries = choose_queries(read_all(source), recording->truth);
  return place;
}

/// Every other still is mapped, the others are asked about.
Result<Place> make_stills(const ListedPlace& listed, Recording* recording, MapId id,
                          const PlacesOptions& options) {
  std::vector<PosedStill> posed;
  std::vector<Frame> others;
  for (const Frame& frame : read_all(recording->source.get())) {
    const SE3* exact = recording->truth.at(frame.time);
    if (exact == nullptr) continue;
    if (frame.index % 2 == 0) {
      posed.push_back({frame.time, frame.image, exact->inverse()});
    } else {
      others.push_back(frame);
    }
  }
  const auto mapped = read_or_make(
      options.keep, listed.name, id,
      [&] { return map_posed_stills(recording->camera, posed, id, options.seed); }, [] {});
  auto place = place_of(mapped, listed, "stills, posed", *recording);
  if (place) place->queries = choose_queries(others, recording->truth);
  return place;
}

Place make_unmapped(const ListedPlace& listed, Recording* recording) {
  Place place{.name = listed.name, .how = "not mapped", .camera = recording->camera};
  place.queries = choose_queries(read_all(recording->source.get()), {});
  return place;
}

Result<Place> make_place(const ListedPlace& listed, MapId id, const PlacesOptions& options) {
  auto recording = open_recording(listed, options);
  if (!recording) return tl::unexpected(recording.error());
  switch (listed.kind) {
    case ListedPlace::Kind::kVideo:
      return make_video(listed, &*recording, id, options);
    case ListedPlace::Kind::kStills:
      return make_stills(listed, &*recording, id, options);
    default:
      return make_unmapped(listed, &*recording);
  }
}

}  // namespace

Result<Places> make_places(const PlacesOptions& options) {
  const auto content = read_text_file(options.list);
  if (!content) return tl::unexpected(content.error());
  const auto list = parse_places(*content, options.list);
  if (!list) return tl::unexpected(list.error());
  if (!fs::is_directory(options.recordings))
    return fail(ErrorCode::kNotFound, options.recordings.string() + ": no such folder of recordings");
  Places places;
  for (const ListedPlace& listed : *list) {
    auto place = make_place(listed, map_id(places.made.size()), options);
    if (!place) {
      std::fprintf(stderr, "%s is left out: %s\n", listed.name.c_str(), place.error().message.c_str());
      places.left_out.push_back(listed.name);
      continue;
    }
    std::fprintf(stderr, "%s: %zu keyframes, %zu queries\n", place->name.c_str(),
                 place->map ? place->map->keyframes.size() : 0, place->queries.size());
    places.made.push_back(std::move(*place));
  }
  if (places.made.empty()) {
    return fail(ErrorCode::kNotFound,
                fmt::format("nothing that {} lists is in {}; pass the folder of recordings as DATA_DIR",
                            options.list.string(), options.recordings.string()));
  }
  return places;
}

}  // namespace cairn
