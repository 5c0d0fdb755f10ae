// SPDX-License-Identifier: Apache-2.0
#include "client/app/narrator.h"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <map>
#include <utility>

#include "common/base/utf8.h"

namespace cairn {
namespace {

constexpr std::chrono::seconds kProgressPeriod(1);
constexpr std::chrono::seconds kImuPatience(2);
constexpr size_t kProgressBytes = 4096;  ///< of lines that a terminal has not yet taken

/// The terminal's stream; null where stderr is no terminal, or one that cannot erase a line.
std::unique_ptr<StreamWriter> open_terminal() {
  const char* term = std::getenv("TERM");
  const bool erases = isatty(STDERR_FILENO) == 1 && (term == nullptr || std::strcmp(term, "dumb") != 0);
  return erases ? StreamWriter::of_descriptor(STDERR_FILENO, "terminal", kProgressBytes) : nullptr;
}

std::string map_text(const FrameReport& report) {
  const std::string id = to_hex(report.result.map.bytes).substr(0, 8);
  const bool named =
      report.snapshot && report.snapshot->map == report.result.map && !report.snapshot->name.empty();
  return named ? report.snapshot->name + " (" + id + ")" : id;
}

}  // namespace

void tell_notes(const std::vector<SourceNote>& notes, const Logger& log) {
  for (const SourceNote& note : notes)
    log->log(note.is_warning ? spdlog::level::warn : spdlog::level::info, "{}", note.text);
}

Narrator::Narrator(Logger log, const PaceClock& clock, std::optional<size_t> frame_count)
    : log_(std::move(log)), clock_(clock), frame_count_(frame_count), terminal_(open_terminal()) {}

void Narrator::on_frame(const FrameReport& report) {
  number_ = report.number;
  tell_map(report);
  tell_tracking(report);
  tell_rig(report);
  tell_imu(report);
  map_seen_ = map_seen_ || report.snapshot;
  if (!map_ && !report.result.note.empty()) why_no_map_ = report.result.note;
  seed_waits_ = seed_waits_ || report.result.seed;
  const auto now = clock_.now();
  if (last_progress_ && now - *last_progress_ < kProgressPeriod) return;
  last_progress_ = now;
  show_progress(report);
}

/// Tells what the rig does when that changes. Numbers do not count: the progress of a search would be a line
/// for each frame.
void Narrator::tell_rig(const FrameReport& report) {
  const std::string rig = without_numbers(report.rig);
  if (rig == rig_) return;
  rig_ = rig;
  if (!report.rig.empty()) log_->info("frame {}: {}", report.number, report.rig);
}

void Narrator::tell_map(const FrameReport& report) {
  if (!is_tracked(report.state) || report.result.map == map_) return;
  if (map_) {
    log_->info("frame {}: now in map {}", report.number, map_text(report));
  } else {
    log_->info("map {} {} at frame {}: {} of {} points found", map_text(report),
               made_map_ ? "started" : "entered", report.number, report.result.found,
               report.result.attempted);
  }
  map_ = report.result.map;
}

void Narrator::tell_tracking(const FrameReport& report) {
  const std::string why = report.result.note.empty() ? "" : ": " + report.result.note;
  if (report.state == FrameState::kLost && !map_) {
    if (!std::exchange(looks_for_place_, true))
      log_->info("frame {}: not in a map yet{}", report.number, why);
  } else if (report.state == FrameState::kLost && !lost_since_) {
    lost_since_ = report.number;
    log_->warn("frame {}: lost{}", report.number, why);
  } else if (is_tracked(report.state) && lost_since_) {
    log_->info("frame {}: found again after {} frames", report.number, report.number - *lost_since_);
    lost_since_.reset();
  }
}

std::string Narrator::progress_text(const FrameReport& report, std::optional<size_t> frame_count,
                                    size_t dropped) {
  const auto& result = report.result;
  std::string text = fmt::format("frame {}", report.number);
  if (frame_count) text += fmt::format("/{}", *frame_count);
  text += fmt::format(" {}", to_string(report.state));
  if (is_tracked(report.state)) {
    text += fmt::format(", {}/{} points", result.found, result.attempted);
  } else if (!result.note.empty()) {
    text += ": " + result.note;
  }
  if (report.snapshot) {
    text += fmt::format(", map of {} keyframes, {} points", report.snapshot->keyframe_count(),
                        report.snapshot->point_count());
  }
  text += fmt::format(", {:.1f} ms", std::chrono::duration<double, std::milli>(report.cpu).count());
  if (dropped > 0) text += fmt::format(", {} dropped", dropped);
  return text;
}

void Narrator::show_progress(const FrameReport& report) {
  const auto text = progress_text(report, frame_count_, dropped_);
  if (!terminal_) {
    log_->info("{}", text);
  } else if (log_->should_log(spdlog::level::info)) {
    // Erased first and left with the cursor at its start, so that whatever is logged next replaces it.
    (void)terminal_->write("\r\x1b[K" + one_line(text) + "\r");
  }
}

void Narrator::on_undecodable(const UndecodableReport& report) {
  number_ = report.number;
  log_->warn("frame {} cannot be used: {}", report.number, report.reason);
}

void Narrator::on_seed_reply(const SeedReply& reply) {
  made_map_ = made_map_ || reply.answer;
  seed_waits_ = false;
  if (reply.answer) {
    log_->info("the server made map {} from our two views: {} points",
               to_hex(reply.answer->map.bytes).substr(0, 8), reply.answer->points.size());
  } else {
    why_no_map_ = reply.reason;
    tell_refusal("the server refused to start a map: " + reply.reason);
  }
}

/// A tracker that is refused a map begins another at once.
void Narrator::tell_refusal(const std::string& refusal) {
  if (const auto said = refusals_.say(without_numbers(refusal), refusal, clock_.now()))
    log_->info("{}", *said);
}

/// Tells one line for each verdict and reason: a restarted server refuses a whole spool at once.
void Narrator::on_offer_replies(const std::vector<OfferReply>& replies) {
  std::map<std::string, size_t> verdicts;
  for (const auto& reply : replies) {
    const std::string verdict = reply.accepted     ? "accepted"
                                : reply.kept_aside ? reply.reason
                                                   : "refused: " + reply.reason;
    ++verdicts[verdict];
  }
  for (const auto& [verdict, count] : verdicts) {
    if (verdict.starts_with("refused: ")) {
      tell_refusal(
          fmt::format("{} {}", count == 1 ? "keyframe" : fmt::format("{} keyframes", count), verdict));
      continue;
    }
    log_->info("frame {}: {} {}", number_, count == 1 ? "keyframe" : fmt::format("{} keyframes", count),
               verdict);
  }
}

/// Tells faults of the link. The session itself tells that the server is there, also before the first frame.
void Narrator::on_status(const SessionStatus& status) {
  server_text_ = status.text;
  const bool fault =
      status.link == ServerLink::kGone || status.link == ServerLink::kRestarted || !status.map_known;
  if (fault && !status.text.empty()) log_->warn("{}", status.text);
}

/// A step that is no answer yet, or the same one again, is for the curious.
void Narrator::on_camera(const CameraUpdate& update) {
  const std::string values = describe(update);
  const CameraWord word = update.frozen            ? CameraWord::kKnown
                          : update.cannot_be_known ? CameraWord::kCannotBeKnown
                                                   : CameraWord::kMayBe;
  const bool is_new = word != CameraWord::kMayBe && word != camera_word_;
  if (is_new) camera_word_ = word;
  if (is_new && update.frozen) {
    log_->info("frame {}: the camera is known: {}", number_, values);
  } else if (is_new) {
    log_->warn(
        "frame {}: the focal length cannot be known from this motion: {} so far; move nearer and "
        "farther, turn the camera as it moves, or pass --calibration FILE "
        "(exact:FILE where it has no distortion)",
        number_, values);
  } else {
    log_->debug("frame {}: the camera may be: {}", number_, values);
  }
}

/// Warns once: a server that is gone would settle none of the frames to come.
void Narrator::on_unsettled(size_t frame_number) {
  if (std::exchange(unsettled_, true)) return;
  log_->warn(
      "frame {}: the server did not finish its work on it; going on, this run cannot be repeated exactly",
      frame_number);
}

void Narrator::on_start_over(const StartOverReport& report) {
  log_->info("frame {}: {}: {}", report.number, report.reason,
             report.makes_map ? "starting a new map" : "looking for another map");
  map_ = {};
  lost_since_.reset();
  looks_for_place_ = false;
}

/// A gap of a frame or two is nothing to be told; a gyro that is not used, and why, is.
void Narrator::tell_imu(const FrameReport& report) {
  const ImuUse imu = report.result.imu;
  if (imu == ImuUse::kMissing) return tell_imu_gap(report.frame.time);
  imu_missing_since_.reset();
  if (std::exchange(imu_gap_told_, false) && imu != ImuUse::kNone)
    log_->info("frame {}: samples of the IMU come again", number_);
  if (imu == imu_) return;
  if (imu == ImuUse::kContradicts) {
    log_->warn("frame {}: the IMU turns otherwise than the images do, and is not used: {}", number_,
               report.rig.empty()
                   ? "check --imu-mount, --imu-time-offset and that its rates are rad/s"
                   : "`cairn-rig calibrate` measures how it sits, and what its clock lacks to the camera's");
  } else if (imu_ == ImuUse::kContradicts) {
    log_->info("frame {}: the IMU turns as the images do again, and is used", number_);
  }
  imu_ = imu;
}

/// Warns, once for each gap, when there have been no samples of the IMU for 2 s by the frames' stamps, which
/// may jump back.
void Narrator::tell_imu_gap(Timestamp time) {
  if (!imu_missing_since_ || time < *imu_missing_since_) imu_missing_since_ = time;
  if (imu_gap_told_ || time - *imu_missing_since_ < kImuPatience) return;
  imu_gap_told_ = true;
  log_->warn("frame {}: there have been no samples of the IMU for {} s; tracking goes on without", number_,
             kImuPatience.count());
}

void Narrator::finish() {
  if (terminal_ && last_progress_) (void)terminal_->write("\r\x1b[K");
  for (const std::string& refusal : refusals_.rest()) log_->info("{}", refusal);
}

std::string Narrator::why_no_map() const {
  if (map_) return {};
  if (seed_waits_) return "a map was proposed, but the server never answered (" + server_text_ + ")";
  return why_no_map_;
}

}  // namespace cairn
