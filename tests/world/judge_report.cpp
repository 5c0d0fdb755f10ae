// SPDX-License-Identifier: Apache-2.0
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/io/json_text.h"
#include "tests/world/judge.h"

namespace cairn {
namespace {

std::string place_name(const Verdict& verdict, const std::optional<int>& place) {
  return place ? verdict.places[static_cast<size_t>(*place)].name : "-";
}

std::string map_text(const MapId& id, const std::string& name) {
  return name.empty() ? to_hex(id.bytes).substr(0, 8) : name;
}

nlohmann::json visit_json(const VisitVerdict& visit) {
  nlohmann::json json = {{"frames", visit.frames},
                         {"right", visit.right},
                         {"elsewhere", visit.elsewhere},
                         {"wrong", visit.wrong},
                         {"frames_to_lock", nullptr}};
  if (visit.frames_to_lock) json["frames_to_lock"] = *visit.frames_to_lock;
  return json;
}

/// "0.2 / 0.5 / 0.9": the nearest ranks of ascending values.
std::string spread_text(const std::vector<double>& values) {
  if (values.empty()) return "-";
  const auto rank = [&](double share) {
    return values[static_cast<size_t>(std::ceil(share * static_cast<double>(values.size()))) - 1];
  };
  return fmt::format("{:.2f} / {:.2f} / {:.2f}", rank(0.5), rank(0.95), rank(1));
}

std::string labels_text(const Verdict& verdict) {
  std::string text =
      "labels: degrees between where they appear and where the thing is, p50 / p95 / max (frames)\n";
  std::vector<double> all;
  for (const LabelVerdict& label : verdict.labels) {
    text += fmt::format("{:<14}{} ({})\n", place_name(verdict, label.place),
                        label.placed ? spread_text(label.degrees) : "not in a map of its place",
                        label.degrees.size());
    all.insert(all.end(), label.degrees.begin(), label.degrees.end());
  }
  std::ranges::sort(all);
  return text + fmt::format("labels placed {} of {}, {} degrees ({})\n", verdict.labels_placed(),
                            verdict.labels.size(), spread_text(all), all.size());
}

}  // namespace

std::string verdict_text(const Verdict& verdict) {
  std::string text = fmt::format("{:<14}{:>7}{:>6}  {}\n", "place", "to map", "maps",
                                 "visits: frames to lock (right + in another map + wrong, of frames)");
  for (const RelocalizationVerdict& place : verdict.places) {
    text += fmt::format("{:<14}{:>7}{:>6} ", place.name, place.to_map ? "yes" : "no", place.maps);
    for (const VisitVerdict& visit : place.visits) {
      const std::string lock = visit.frames_to_lock ? std::to_string(*visit.frames_to_lock) : "-";
      text += fmt::format(" {} ({} + {} + {} of {})", lock, visit.right, visit.elsewhere, visit.wrong,
                          visit.frames);
    }
    text += '\n';
  }
  for (const MapVerdict& map : verdict.maps) {
    if (map.homes.size() < 2) continue;
    text += fmt::format("map {} is of {} places; drift in metres from {}:", map_text(map.id, map.name),
                        map.homes.size(), place_name(verdict, map.home));
    for (const HomeVerdict& home : std::span(map.homes).subspan(1))
      text += fmt::format(" {} {:.3f}", place_name(verdict, home.place), home.drift);
    text += '\n';
  }
  for (const WrongLock& lock : verdict.wrong_locks) {
    text += fmt::format("wrong: walk {} at {:.3f} s, {} frames in map {}, {:.2f} m off, before {}{}{}\n",
                        lock.walk + 1, lock.begin.seconds(), lock.frames, map_text(lock.map, lock.map_name),
                        lock.metres, place_name(verdict, lock.shown),
                        lock.at_unmapped ? " (unmapped place visited)" : "",
                        lock.excused() ? " (held too long)"
                        : lock.held    ? " (glided)"
                                       : "");
  }
  if (!verdict.labels.empty()) text += labels_text(verdict);
  const auto excused = static_cast<size_t>(verdict.locks_excused());
  text += fmt::format(
      "mapped {} of {}, found at every visit {} of {}, wrong locks {}, {} of them at unmapped places, held "
      "too long {}\n",
      verdict.places_mapped(), verdict.places_to_map(), verdict.places_found(), verdict.places_to_map(),
      verdict.wrong_locks.size() - excused, verdict.locks_at_unmapped(), excused);
  return text;
}

std::string verdict_json(const Verdict& verdict) {
  nlohmann::json json = {
      {"to_map", verdict.places_to_map()},        {"mapped", verdict.places_mapped()},
      {"found", verdict.places_found()},          {"locks_at_unmapped", verdict.locks_at_unmapped()},
      {"locks_excused", verdict.locks_excused()}, {"places", nlohmann::json::array()},
      {"maps", nlohmann::json::array()},          {"wrong_locks", nlohmann::json::array()},
      {"labels", nlohmann::json::array()}};
  for (const RelocalizationVerdict& place : verdict.places) {
    auto visits = nlohmann::json::array();
    for (const VisitVerdict& visit : place.visits) visits.push_back(visit_json(visit));
    json["places"].push_back(
        {{"name", place.name}, {"to_map", place.to_map}, {"maps", place.maps}, {"visits", visits}});
  }
  for (const MapVerdict& map : verdict.maps) {
    auto homes = nlohmann::json::array();
    for (const HomeVerdict& home : map.homes)
      homes.push_back({{"place", place_name(verdict, home.place)}, {"drift", home.drift}});
    json["maps"].push_back({{"id", to_hex(map.id.bytes)},
                            {"name", map.name},
                            {"home", place_name(verdict, map.home)},
                            {"homes", homes},
                            {"judged", map.judged},
                            {"right", map.right},
                            {"wrong", map.wrong}});
  }
  for (const WrongLock& lock : verdict.wrong_locks) {
    json["wrong_locks"].push_back({{"map", to_hex(lock.map.bytes)},
                                   {"shown", place_name(verdict, lock.shown)},
                                   {"walk", lock.walk + 1},
                                   {"t", lock.begin.seconds()},
                                   {"frames", lock.frames},
                                   {"metres", lock.metres},
                                   {"at_unmapped", lock.at_unmapped},
                                   {"held", lock.held},
                                   {"excused", lock.excused()}});
  }
  for (const LabelVerdict& label : verdict.labels) {
    json["labels"].push_back(
        {{"place", place_name(verdict, label.place)}, {"placed", label.placed}, {"degrees", label.degrees}});
  }
  return json_text(json, 1) + "\n";
}

}  // namespace cairn
