// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/app/frame_observer.h"
#include "common/base/log.h"
#include "common/base/repeats.h"
#include "common/base/stream_writer.h"
#include "common/map/ids.h"

namespace cairn {

/// Tells what was noticed when a source was opened.
void tell_notes(const std::vector<SourceNote>& notes, const Logger& log);

/// Tells a person on stderr what happens: maps started, tracking lost and found, the server's verdicts with
/// their reasons, the server gone and back; and once a second how far the run is. On a terminal the progress
/// line stays in place.
class Narrator final : public FrameObserver {
 public:
  /// `frame_count` of the source if known. The clock gives the seconds between progress lines.
  Narrator(Logger log, const PaceClock& clock, std::optional<size_t> frame_count);

  void on_frame(const FrameReport& report) override;
  void on_dropped(const DroppedReport&) override { ++dropped_; }
  void on_undecodable(const UndecodableReport& report) override;
  void on_seed_reply(const SeedReply& reply) override;
  void on_offer_replies(const std::vector<OfferReply>& replies) override;
  void on_status(const SessionStatus& status) override;
  void on_camera(const CameraUpdate& update) override;
  void on_unsettled(size_t frame_number) override;
  void on_start_over(const StartOverReport& report) override;

  /// Ends the progress line.
  void finish();
  /// Why a run ended in no map, as far as the tracker and the server told; empty after a run that ended in
  /// one.
  [[nodiscard]] std::string why_no_map() const;

  /// "frame 120/600 tracking, 412/530 points, map of 7 keyframes, 1890 points, 6.1 ms"
  [[nodiscard]] static std::string progress_text(const FrameReport& report, std::optional<size_t> frame_count,
                                                 size_t dropped);

 private:
  void tell_map(const FrameReport& report);
  void tell_refusal(const std::string& refusal);
  void tell_tracking(const FrameReport& report);
  void tell_rig(const FrameReport& report);
  void tell_imu(const FrameReport& report);
  void tell_imu_gap(Timestamp time);
  void show_progress(const FrameReport& report);

  enum class CameraWord : uint8_t { kMayBe, kKnown, kCannotBeKnown };

  Logger log_;
  const PaceClock& clock_;
  const std::optional<size_t> frame_count_;
  const std::unique_ptr<StreamWriter>
      terminal_;  ///< stderr, where it is one that can erase a line; else null
  std::optional<PaceClock::TimePoint> last_progress_;
  size_t number_ = 0;  ///< of the last frame
  size_t dropped_ = 0;
  MapId map_;
  std::optional<size_t> lost_since_;
  bool looks_for_place_ = false;                 ///< has been said
  bool made_map_ = false;                        ///< of our own views
  bool map_seen_ = false;                        ///< tracked in or not
  CameraWord camera_word_ = CameraWord::kMayBe;  ///< the last one said
  bool unsettled_ = false;
  ImuUse imu_ = ImuUse::kNone;  ///< the last one said
  std::optional<Timestamp> imu_missing_since_;
  bool imu_gap_told_ = false;
  bool seed_waits_ = false;  ///< for the server's verdict
  std::string why_no_map_;
  std::string server_text_;
  Repeats refusals_;
  std::string rig_;  ///< as said last, without its numbers
};

}  // namespace cairn
