// SPDX-License-Identifier: Apache-2.0
#include "client/app/stats.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "client/app/on_time.h"
#include "common/io/json_text.h"

namespace cairn {
namespace {

using Json = nlohmann::ordered_json;

double to_ms(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

/// Times to the microsecond: more digits would only make the file long.
double rounded_ms(double ms) {
  return std::round(ms * 1e3) / 1e3;
}

Json percentiles(const Histogram& times) {
  return {{"p50", rounded_ms(times.percentile(0.50))},
          {"p95", rounded_ms(times.percentile(0.95))},
          {"p99", rounded_ms(times.percentile(0.99))}};
}

/// The percentiles of times, and how many times there are: maybe none.
Json counted_percentiles(const Histogram& times) {
  Json json = percentiles(times);
  json["count"] = times.count();
  return json;
}

/// Points that are looked through, newest first, for one of a new keyframe: those of the last few keyframes.
constexpr int kBlocksLookedThrough = 32;
/// A keyframe without new points (all that it shows was known) is not waited for longer than this [s].
constexpr double kAwaitedAtMost = 5;

bool has_point_of(const MapSnapshot& snapshot, KeyframeId keyframe) {
  const auto& blocks = snapshot.point_blocks;
  const auto least = blocks.size() - std::min<size_t>(blocks.size(), kBlocksLookedThrough);
  return std::any_of(
      blocks.begin() + static_cast<std::ptrdiff_t>(least), blocks.end(), [&](const auto& block) {
        const auto& sources = block->patches->points;
        return std::any_of(sources.begin(), sources.end(),
                           [&](const PointSource& source) { return source.keyframe == keyframe; });
      });
}

Json map_json(const MapId& map) {
  return map ? Json(to_hex(map.bytes)) : Json(nullptr);
}

double share(size_t part, size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

}  // namespace

const char* to_string(FrameState state) {
  switch (state) {
    case FrameState::kStarting:
      return "starting";
    case FrameState::kTracking:
      return "tracking";
    case FrameState::kPoor:
      return "poor";
    case FrameState::kLost:
      return "lost";
    case FrameState::kDropped:
      return "dropped";
    case FrameState::kRotation:
      return "rotation";
  }
  return "?";
}

StageTimes StageClock::take() {
  return std::exchange(times_, StageTimes{});
}

void RunStats::add(const FrameRow& row) {
  ++frames_total_;
  ++counts_[static_cast<size_t>(row.state)];
  // A frame without a whole pose is late. Before there is a map none can have one.
  const bool has_no_pose = row.state == FrameState::kDropped || row.state == FrameState::kLost ||
                           row.state == FrameState::kRotation;
  on_time_ += !has_no_pose && row.wall_ms <= kOnTimeMs ? 1 : 0;
  last_time_ = row.time;
  if (list_ == FrameList::kKept) frames_.push_back(row);
}

void RunStats::on_frame(const FrameReport& report) {
  const auto& result = report.result;
  FrameRow row{report.frame.time, report.state,      {}, result.found, result.attempted,
               to_ms(report.cpu), to_ms(report.wall)};
  if (!first_map_frame_ && report.state != FrameState::kStarting) first_map_frame_ = frames_total_;
  if (report.state == FrameState::kStarting) starting_ms_.add(row.cpu_ms);
  if (report.state == FrameState::kLost) lost_ms_.add(row.cpu_ms);
  if (report.state == FrameState::kRotation) {
    row.map = result.map;
    row.rotation = result.camera_from_map.inverse().rotation();
  }
  if (is_tracked(report.state)) {
    row.map = result.map;
    if (current_map_ && current_map_ != result.map) {
      ++switches_;
      awaited_.clear();  // keyframes of the other map
    }
    current_map_ = result.map;
    for (size_t s = 0; s < kStageCount; ++s) stage_ms_[s].add(to_ms(report.stages[s]));
    stage_ms_[kStageCount].add(row.cpu_ms);
    squared_error_sum_ += result.reprojection_rms * result.reprojection_rms * result.found;
    inlier_sum_ += static_cast<size_t>(std::max(0, result.found));
  }
  if (report.snapshot) {
    map_points_ = report.snapshot->point_count();
    map_keyframes_ = report.snapshot->keyframe_count();
    note_new_points(*report.snapshot, report.frame.time);
  }
  add(row);
}

void RunStats::on_dropped(const DroppedReport& report) {
  FrameRow row;
  row.time = report.time;
  add(row);
}

void RunStats::on_undecodable(const UndecodableReport&) {
  FrameRow row;
  row.time = last_time_;
  add(row);
  ++undecodable_;
}

void RunStats::on_seed_reply(const SeedReply& reply) {
  seeds_refused_ += reply.answer ? 0 : 1;
}

void RunStats::on_offer_replies(const std::vector<OfferReply>& replies) {
  for (const auto& reply : replies) {
    ++(reply.accepted ? offers_accepted_ : reply.kept_aside ? offers_kept_aside_ : offers_refused_);
    if (!reply.accepted) continue;
    awaited_.emplace_back(reply.keyframe, reply.time);
    looked_through_ = {};  // its points may have come before the word on it
  }
}

void RunStats::note_new_points(const MapSnapshot& snapshot, Timestamp now) {
  if (awaited_.empty() || snapshot.revision == looked_through_) return;
  looked_through_ = snapshot.revision;
  std::erase_if(awaited_, [&](const auto& awaited) {
    const double seconds = seconds_between(now, awaited.second);
    if (seconds > kAwaitedAtMost) return true;
    if (!has_point_of(snapshot, awaited.first)) return false;
    points_after_ms_.add(1e3 * seconds);
    return true;
  });
}

void RunStats::on_relocalization_answer(const PlaceReport& report) {
  if (list_ == FrameList::kLeftOut) return;
  const RelocalizationAnswer& answer = report.answer;
  AnswerRow row{report.asked, answer.verdict, {}, report.tried};
  if (has_place(answer.verdict) && !answer.candidates.empty()) row.map = answer.candidates.front().map;
  answers_.push_back(row);
}

double RunStats::tracked_share() const {
  return first_map_frame_ ? share(tracked(), frames_total_ - *first_map_frame_) : 0.0;
}

double RunStats::on_time_share() const {
  return share(on_time_, frames_total_);
}

std::string RunStats::to_json(uint64_t bytes_sent, uint64_t bytes_received) const {
  Json json{{"frames_total", frames_total_},
            {"tracked", tracked()},
            {"dropped", count(FrameState::kDropped)},
            {"lost", count(FrameState::kLost)},
            {"rotation", count(FrameState::kRotation)},
            {"switches", switches_},
            {"first_map_frame", first_map_frame_ ? Json(*first_map_frame_) : Json(nullptr)},
            {"bytes_sent", bytes_sent},
            {"bytes_received", bytes_received}};
  Json& stages = json["stages_ms"];
  stages["total"] = percentiles(stage_ms_[kStageCount]);
  for (size_t s = 0; s < kStageCount; ++s)
    stages[to_string(static_cast<Stage>(s))] = percentiles(stage_ms_[s]);
  json["starting_ms"] = counted_percentiles(starting_ms_);
  json["lost_ms"] = counted_percentiles(lost_ms_);
  json["keyframe_to_points_ms"] = counted_percentiles(points_after_ms_);
  if (rig_) {
    json["rig"] = {{"name", rig_->name},
                   {"text", rig_->text},
                   {"searches", rig_->searches},
                   {"candidates", rig_->candidates}};
    if (const auto& point = rig_->fixated) json["rig"]["fixated"] = {point->x(), point->y(), point->z()};
  }
  if (images_) {
    json["pictures"] = {{"sent", images_->sent},
                        {"received", images_->received},
                        {"asked_s", std::chrono::duration<double>(images_->asked).count()},
                        {"cpu_ms", std::chrono::duration<double, std::milli>(images_->cpu).count()}};
  }
  json["summary"] = {
      {"tracked_share", tracked_share()},
      {"on_time_share", on_time_share()},
      {"undecodable", undecodable_},
      {"seeds_refused", seeds_refused_},
      {"keyframes_accepted", offers_accepted_},
      {"keyframes_refused", offers_refused_},
      {"keyframes_kept_aside", offers_kept_aside_},
      {"map_keyframes", map_keyframes_},
      {"map_points", map_points_},
      {"reprojection_rms_px", inlier_sum_ == 0 ? 0.0 : std::sqrt(squared_error_sum_ / inlier_sum_)}};
  Json frames = Json::array();
  for (const auto& row : frames_) {
    frames.push_back({{"t", row.time.seconds()},
                      {"state", to_string(row.state)},
                      {"map", map_json(row.map)},
                      {"inliers", row.inliers},
                      {"attempted", row.attempted},
                      {"cpu_ms", rounded_ms(row.cpu_ms)},
                      {"wall_ms", rounded_ms(row.wall_ms)}});
    if (row.state != FrameState::kRotation) continue;
    const auto& q = row.rotation;
    frames.back()["rotation"] = {q.x(), q.y(), q.z(), q.w()};
  }
  json["frames"] = std::move(frames);
  Json answers = Json::array();
  for (const auto& row : answers_) {
    answers.push_back({{"t", row.asked.seconds()},
                       {"verdict", to_string(row.verdict)},
                       {"map", map_json(row.map)},
                       {"tried", row.tried}});
  }
  json["answers"] = std::move(answers);
  return json_text(json, 1) + "\n";
}

std::optional<std::string> RunStats::shortfall(const std::string& why_no_map) const {
  if (frames_decoded() == 0) return std::nullopt;  // the source's fault, which it tells
  std::vector<std::string> words;
  if (tracked() == 0) {
    words.emplace_back(first_map_frame_ ? "the run was in a map and never tracked: no frame has a pose"
                                        : "the run ends without a map: no frame has a pose");
    if (!why_no_map.empty()) words.push_back(why_no_map);
  }
  if (const size_t dropped = count(FrameState::kDropped) - undecodable_; 2 * dropped > frames_total_) {
    words.push_back(
        fmt::format("most frames were dropped, {} of {}: they came faster than this machine tracks them; "
                    "--pace max takes "
                    "every frame of a recording, smaller images or a lower rate suit a camera",
                    dropped, frames_total_));
  }
  if (words.empty()) return std::nullopt;
  return fmt::format("{}", fmt::join(words, "; "));
}

std::vector<std::string> RunStats::summary_lines() const {
  std::vector<std::string> lines;
  const size_t dropped = count(FrameState::kDropped) - undecodable_;
  lines.push_back(fmt::format(
      "{} frames: {} tracked, {} poor, {} rotation, {} lost, {} starting, {} dropped, {} undecodable",
      frames_total_, count(FrameState::kTracking), count(FrameState::kPoor), count(FrameState::kRotation),
      count(FrameState::kLost), count(FrameState::kStarting), dropped, undecodable_));
  if (!first_map_frame_) {
    lines.emplace_back("no map was begun or found");
    return lines;
  }
  if (tracked() == 0) {
    lines.push_back(fmt::format("in a map from frame {}, never tracked", *first_map_frame_));
    return lines;
  }
  const auto& total = stage_ms_[kStageCount];
  lines.push_back(fmt::format("map from frame {}; since then {:.1f} % tracked; {} map switches",
                              *first_map_frame_, 100 * tracked_share(), switches_));
  lines.push_back(
      fmt::format("{} keyframes and {} points in the map; {} keyframes accepted, {} refused{}",
                  map_keyframes_, map_points_, offers_accepted_, offers_refused_,
                  offers_kept_aside_ == 0 ? "" : fmt::format(", {} kept aside", offers_kept_aside_)));
  lines.push_back(fmt::format(
      "processor time per tracked frame: p50 {:.1f} ms, p95 {:.1f} ms, p99 {:.1f} ms; "
      "{:.1f} % of all frames on time",
      total.percentile(0.50), total.percentile(0.95), total.percentile(0.99), 100 * on_time_share()));
  return lines;
}

}  // namespace cairn
