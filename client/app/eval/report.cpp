// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/report.h"

#include <array>
#include <cstdarg>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "client/app/on_time.h"
#include "common/base/utf8.h"
#include "common/io/json_text.h"

namespace cairn {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kDegreesPerRadian = 180 / std::numbers::pi;

[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...) {
  std::array<char, 1024> text{};
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(text.data(), text.size(), pattern, arguments);
  va_end(arguments);
  return text.data();
}

const char* name_of(Alignment alignment) {
  return alignment == Alignment::kSim3 ? "sim3" : "se3";
}
const char* name_of(DeltaUnit unit) {
  return unit == DeltaUnit::kFrames ? "f" : unit == DeltaUnit::kMetres ? "m" : "s";
}

Json statistics_json(const ErrorStatistics& s, double factor) {
  return {{"count", s.count},         {"rmse", factor * s.rmse},
          {"mean", factor * s.mean},  {"median", factor * s.median},
          {"std", factor * s.stddev}, {"min", factor * s.min},
          {"max", factor * s.max}};
}

std::string statistics_text(const char* title, const ErrorStatistics& s, double factor, const char* unit) {
  return format("%s [%s]  rmse %.6f  mean %.6f  median %.6f  std %.6f  min %.6f  max %.6f\n", title, unit,
                factor * s.rmse, factor * s.mean, factor * s.median, factor * s.stddev, factor * s.min,
                factor * s.max);
}

/// The map that most of the matched poses lie in.
const MapAlignment& largest_map(const Comparison& comparison) {
  const MapAlignment* largest = &comparison.maps.front();
  for (const auto& map : comparison.maps) {
    if (map.is_aligned && (!largest->is_aligned || map.pairs.size() > largest->pairs.size())) largest = &map;
  }
  return *largest;
}

Json comparison_json(const char* metric, const Comparison& comparison, Alignment alignment) {
  Json maps = Json::array();
  for (const auto& map : comparison.maps) {
    Json entry = {{"map", map.map ? Json(to_hex(map.map.bytes)) : Json(nullptr)},
                  {"name", map.name},
                  {"poses", map.poses.size()},
                  {"matched", map.pairs.size()},
                  {"aligned", map.is_aligned}};
    if (map.is_aligned) {
      entry["scale"] = map.truth_from_map.scale();
      entry["ate"] = statistics_json(map.translation, 1);
    }
    maps.push_back(std::move(entry));
  }
  return {{"metric", metric},
          {"align", name_of(alignment)},
          {"truth_poses", comparison.truth_poses},
          {"estimate_poses", comparison.estimate_poses},
          {"matched", comparison.matched},
          {"unaligned", comparison.unaligned},
          {"scale", largest_map(comparison).truth_from_map.scale()},
          {"path_length", comparison.path_length},
          {"maps", std::move(maps)},
          {"notes", comparison.notes}};
}

std::string comparison_text(const char* metric, const Comparison& comparison, Alignment alignment) {
  auto text = format(
      "%s, align %s: %zu poses matched of %zu in the estimate, %zu in the truth; path %.3f m; scale %.6g\n",
      metric, name_of(alignment), comparison.matched, comparison.estimate_poses, comparison.truth_poses,
      comparison.path_length, largest_map(comparison).truth_from_map.scale());
  if (comparison.maps.size() < 2 && comparison.unaligned == 0) return text;
  for (const auto& map : comparison.maps) {
    text += "  map " + to_hex(map.map.bytes) + " " + map.name;
    text += map.is_aligned ? format(": %zu matched, scale %.6g, ate rmse %.6f m\n", map.pairs.size(),
                                    map.truth_from_map.scale(), map.translation.rmse)
                           : format(": %zu matched, too few or on a line: left out\n", map.pairs.size());
  }
  return text;
}

Json percentiles_json(const Percentiles& p) {
  return {{"p50", p.p50}, {"p95", p.p95}, {"p99", p.p99}};
}

}  // namespace

std::string ate_text(const Comparison& comparison, const AbsoluteError& error, Alignment alignment) {
  return comparison_text("ate", comparison, alignment) +
         statistics_text("translation", error.translation, 1, "m");
}

std::string ate_json(const Comparison& comparison, const AbsoluteError& error, Alignment alignment) {
  auto document = comparison_json("ate", comparison, alignment);
  document.update(statistics_json(error.translation, 1));
  return json_text(document, 2) + "\n";
}

std::string rpe_text(const Comparison& comparison, const RelativeError& error, Alignment alignment,
                     const RelativeOptions& options) {
  return comparison_text("rpe", comparison, alignment) +
         format("delta %g %s, %zu pairs\n", options.delta, name_of(options.unit), error.translation.count) +
         statistics_text("translation", error.translation, 1, "m") +
         statistics_text("rotation", error.rotation, kDegreesPerRadian, "deg");
}

std::string rpe_json(const Comparison& comparison, const RelativeError& error, Alignment alignment,
                     const RelativeOptions& options) {
  auto document = comparison_json("rpe", comparison, alignment);
  document["delta"] = options.delta;
  document["delta_unit"] = name_of(options.unit);
  document["translation"] = statistics_json(error.translation, 1);
  document["rotation_deg"] = statistics_json(error.rotation, kDegreesPerRadian);
  return json_text(document, 2) + "\n";
}

std::string stats_text(const std::vector<NamedRun>& runs) {
  std::string text;
  for (const auto& [file, s] : runs) {
    text += one_line(file) + "\n";
    text += format("  frames %ld, first map at %s\n", static_cast<long>(s.frames_total),
                   s.first_map_frame ? std::to_string(*s.first_map_frame).c_str() : "none");
    text += format(
        "  tracked %.2f %% (%ld of %ld after the first map; poor %ld, lost %ld, dropped %ld; switches %ld)\n",
        s.tracked_percent, static_cast<long>(s.tracked), static_cast<long>(s.frames_after_map),
        static_cast<long>(s.poor), static_cast<long>(s.lost), static_cast<long>(s.dropped),
        static_cast<long>(s.switches));
    text += format("  cpu ms p50 %.2f p95 %.2f p99 %.2f; wall ms p50 %.2f p95 %.2f p99 %.2f\n", s.cpu_ms.p50,
                   s.cpu_ms.p95, s.cpu_ms.p99, s.wall_ms.p50, s.wall_ms.p95, s.wall_ms.p99);
    text += format("  on time (%.0f ms) %.2f %% of all frames; sent %ld B, received %ld B\n", kOnTimeMs,
                   s.on_time_percent, static_cast<long>(s.bytes_sent), static_cast<long>(s.bytes_received));
  }
  return text;
}

std::string stats_json(const std::vector<NamedRun>& runs) {
  Json documents = Json::array();
  for (const auto& [file, s] : runs) {
    documents.push_back({{"file", path_in_json(file)},
                         {"frames_total", s.frames_total},
                         {"first_map_frame", s.first_map_frame ? Json(*s.first_map_frame) : Json(nullptr)},
                         {"frames_after_map", s.frames_after_map},
                         {"tracked", s.tracked},
                         {"tracked_percent", s.tracked_percent},
                         {"poor", s.poor},
                         {"lost", s.lost},
                         {"dropped", s.dropped},
                         {"switches", s.switches},
                         {"cpu_ms", percentiles_json(s.cpu_ms)},
                         {"wall_ms", percentiles_json(s.wall_ms)},
                         {"on_time_percent", s.on_time_percent},
                         {"bytes_sent", s.bytes_sent},
                         {"bytes_received", s.bytes_received}});
  }
  return json_text(documents, 2) + "\n";
}

}  // namespace cairn
