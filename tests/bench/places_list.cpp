// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/places_list.h"

#include <fmt/format.h>
#include <algorithm>
#include <charconv>
#include <optional>
#include <span>

#include "common/base/suggestion.h"
#include "common/io/text.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using Fields = std::span<const std::string_view>;

struct KindOfRow {
  std::string_view word;
  ListedPlace::Kind kind;
  size_t fields;
  std::string_view form;
};
constexpr KindOfRow kKinds[] = {
    {"video", ListedPlace::Kind::kVideo, 6, "video FOLDER CAMERA TRUTH UNIT FRAMES"},
    {"stills", ListedPlace::Kind::kStills, 5, "stills FOLDER CAMERA TRUTH UNIT"},
    {"unmapped", ListedPlace::Kind::kUnmapped, 3, "unmapped FOLDER CAMERA"},
};
constexpr std::string_view kNone = "-";
constexpr std::string_view kElsewhere = "elsewhere";

std::string given(std::string_view field) {
  return field == kNone ? std::string() : std::string(field);
}

/// A number of frames, from 1 on; nothing if it is none.
std::optional<size_t> parse_frames(std::string_view text) {
  size_t frames = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), frames);
  if (error != std::errc() || end != text.data() + text.size() || frames == 0) return std::nullopt;
  return frames;
}

/// TRUTH UNIT [FRAMES]
Result<void> read_truth(Fields fields, ListedPlace* place) {
  const bool is_video = place->kind == ListedPlace::Kind::kVideo;
  place->asks_elsewhere = is_video && fields[0] == kElsewhere;
  if (!place->asks_elsewhere) place->truth = given(fields[0]);
  if (!is_video && place->truth.empty())
    return fail(ErrorCode::kConfiguration, "stills are mapped by their poses: TRUTH is missing");
  if (fields[1] != "m" && fields[1] != kNone)
    return fail(ErrorCode::kConfiguration, in_quotes(fields[1]) + " is no UNIT: m or -");
  place->is_metric = fields[1] == "m";
  if (!is_video) return {};
  const auto frames = parse_frames(fields[2]);
  if (!frames) return fail(ErrorCode::kConfiguration, in_quotes(fields[2]) + " is no number of FRAMES");
  place->mapped_frames = *frames;
  return {};
}

Result<ListedPlace> parse_place(Fields fields) {
  const auto kind = std::find_if(std::begin(kKinds), std::end(kKinds),
                                 [&](const KindOfRow& k) { return k.word == fields.front(); });
  if (kind == std::end(kKinds)) {
    return fail(ErrorCode::kConfiguration, "no kind of place is " + in_quotes(fields.front()) +
                                               did_you_mean(fields.front(), {"video", "stills", "unmapped"}));
  }
  if (fields.size() != kind->fields)
    return fail(ErrorCode::kConfiguration, fmt::format("{} fields; expected {}", fields.size(), kind->form));
  ListedPlace place{.kind = kind->kind, .name = std::string(fields[1]), .camera = given(fields[2])};
  if (place.name.find('/') != std::string::npos)
    return fail(ErrorCode::kConfiguration, in_quotes(fields[1]) + " is no name of a folder");
  if (place.kind != ListedPlace::Kind::kUnmapped) {
    if (const Status done = read_truth(fields.subspan(3), &place); !done) return tl::unexpected(done.error());
  }
  return place;
}

Result<std::string> find_source(const fs::path& folder) {
  const std::string at = folder.string();
  if (!fs::is_directory(folder)) return fail(ErrorCode::kNotFound, at + ": no such folder");
  if (fs::exists(folder / "rgb.txt")) return "tum:" + at;
  if (fs::exists(folder / "video.mp4") && fs::exists(folder / "times.txt"))
    return "video:" + at + "/video.mp4?times=" + at + "/times.txt";
  return fail(ErrorCode::kNotFound, at + ": holds neither rgb.txt nor video.mp4 and times.txt");
}

}  // namespace

Result<std::vector<ListedPlace>> parse_places(std::string_view content, const fs::path& name) {
  std::vector<ListedPlace> places;
  for (const TextLine& line : data_lines(content)) {
    auto place = parse_place(split_fields(line.text));
    if (!place) return fail(place.error().code, at_line(name, line.number, place.error().message));
    if (std::any_of(places.begin(), places.end(), [&](const auto& p) { return p.name == place->name; }))
      return fail(ErrorCode::kConfiguration, at_line(name, line.number, place->name + " is listed twice"));
    places.push_back(std::move(*place));
  }
  if (places.empty()) return fail(ErrorCode::kConfiguration, name.string() + ": lists no places");
  return places;
}

Result<PlaceFiles> find_files(const ListedPlace& place, const fs::path& recordings, const fs::path& beside) {
  const fs::path folder = recordings / place.name;
  const auto source = find_source(folder);
  if (!source) return tl::unexpected(source.error());
  PlaceFiles files{.source = *source};
  if (!place.truth.empty()) files.truth = folder / place.truth;
  if (place.camera.empty()) return files;
  for (const fs::path& there : {folder, beside}) {
    if (!fs::exists(there / place.camera)) continue;
    files.camera = there / place.camera;
    return files;
  }
  return fail(ErrorCode::kNotFound, fmt::format("{} is neither in {} nor beside the list, in {}",
                                                place.camera, folder.string(), beside.string()));
}

}  // namespace cairn
