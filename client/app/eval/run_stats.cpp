// SPDX-License-Identifier: Apache-2.0
#include "client/app/eval/run_stats.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string>

#include "client/app/on_time.h"

namespace cairn {
namespace {

using Json = nlohmann::json;

constexpr std::array<std::string_view, 6> kStates = {"starting", "tracking", "poor",
                                                     "lost",     "dropped",  "rotation"};

/// Totals of the `frames` list.
struct FrameTotals {
  int64_t tracking = 0;
  int64_t poor = 0;
  int64_t on_time = 0;
  Histogram cpu_ms;
  Histogram wall_ms;
};

FrameTotals total_frames(const Json& frames) {
  FrameTotals totals;
  for (const auto& frame : frames) {
    const auto state = frame.at("state").get<std::string>();
    if (std::find(kStates.begin(), kStates.end(), state) == kStates.end()) {
      throw std::invalid_argument("frames: no such state '" + state + "'");
    }
    if (state == "dropped") continue;
    const auto cpu_ms = frame.at("cpu_ms").get<double>();
    const auto wall_ms = frame.at("wall_ms").get<double>();
    const bool has_pose = state != "lost" && state != "rotation";
    totals.on_time += has_pose && wall_ms <= kOnTimeMs ? 1 : 0;  // as RunStats counts
    totals.tracking += state == "tracking" ? 1 : 0;
    totals.poor += state == "poor" ? 1 : 0;
    if (state != "tracking" && state != "poor") continue;
    totals.cpu_ms.add(cpu_ms);
    totals.wall_ms.add(wall_ms);
  }
  return totals;
}

/// Frames in `state` from the first map on.
int64_t count_after(const Json& frames, int64_t first, std::string_view state) {
  int64_t count = 0;
  for (size_t i = static_cast<size_t>(first); i < frames.size(); ++i)
    count += frames[i].at("state") == state ? 1 : 0;
  return count;
}

double percent(int64_t part, int64_t whole) {
  return whole > 0 ? 100.0 * static_cast<double>(part) / static_cast<double>(whole) : 0.0;
}

Percentiles percentiles(const Histogram& times) {
  return {times.percentile(0.50), times.percentile(0.95), times.percentile(0.99)};
}

RunSummary summarize_document(const Json& run) {
  RunSummary summary;
  const auto& frames = run.at("frames");
  if (!frames.is_array()) throw std::invalid_argument("frames: not a list");
  summary.frames_total = run.at("frames_total").get<int64_t>();
  if (summary.frames_total < static_cast<int64_t>(frames.size())) {
    throw std::invalid_argument("frames_total is less than the number of frames listed");
  }
  summary.switches = run.at("switches").get<int64_t>();
  summary.bytes_sent = run.value("bytes_sent", int64_t{0});
  summary.bytes_received = run.value("bytes_received", int64_t{0});
  const auto totals = total_frames(frames);
  summary.on_time_percent = percent(totals.on_time, summary.frames_total);
  summary.cpu_ms = percentiles(totals.cpu_ms);
  summary.wall_ms = percentiles(totals.wall_ms);
  const auto& first = run.at("first_map_frame");
  if (first.is_null() || first.get<int64_t>() < 0) return summary;
  summary.first_map_frame = first.get<int64_t>();
  if (*summary.first_map_frame >= summary.frames_total)
    throw std::invalid_argument("first_map_frame is not a frame");
  // Frames that the list leaves out (the run was cut) count as not tracked: the share is of the source.
  summary.frames_after_map = summary.frames_total - *summary.first_map_frame;
  summary.poor = totals.poor;
  summary.tracked = totals.tracking + totals.poor;
  summary.lost = count_after(frames, *summary.first_map_frame, "lost");
  summary.dropped = count_after(frames, *summary.first_map_frame, "dropped");
  summary.tracked_percent = percent(summary.tracked, summary.frames_after_map);
  return summary;
}

}  // namespace

Result<RunSummary> summarize_run(std::string_view json) {
  try {
    return summarize_document(Json::parse(json));
  } catch (const Json::exception& error) {
    return fail(ErrorCode::kDamaged, std::string("not a --stats file: ") + error.what());
  } catch (const std::invalid_argument& error) {
    return fail(ErrorCode::kDamaged, std::string("not a --stats file: ") + error.what());
  }
}

}  // namespace cairn
