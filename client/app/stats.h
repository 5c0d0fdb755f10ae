// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/tracking/tracker.h"
#include "common/base/cpu_time.h"
#include "common/base/histogram.h"
#include "common/base/time.h"
#include "common/map/ids.h"

namespace cairn {

/// The tracker's stopwatch: processor time of the calling thread per stage, summed over a frame. Stages may
/// be entered several times a frame and may nest; an inner stage is also counted in the outer one.
class StageClock final : public StageProbe {
 public:
  void begin(Stage stage) override { started_[static_cast<size_t>(stage)] = thread_cpu_time(); }
  void end(Stage stage) override {
    const auto s = static_cast<size_t>(stage);
    times_[s] += thread_cpu_time() - started_[s];
  }
  /// Times since the last call.
  [[nodiscard]] StageTimes take();

 private:
  StageTimes started_{};
  StageTimes times_{};
};

/// What the statistics tell about the rig that carries the camera.
struct RigSummary {
  std::string name;
  std::string text;  ///< what it did or what kept it from that, at the end, for a person
  int searches = 0;
  int candidates = 0;
  std::optional<Eigen::Vector3d> fixated;  ///< in the map's frame
};

/// What the statistics tell about the images between the cameras of one wearer on one host.
struct ImageSummary {
  size_t sent = 0;
  size_t received = 0;
  std::chrono::nanoseconds asked{};  ///< how long somebody asked for images of this camera
  std::chrono::nanoseconds cpu{};    ///< of drawing and encoding them
};

/// Collects what `--stats` writes. Used from the thread of the frame loop.
class RunStats final : public FrameObserver {
 public:
  /// The lists of frames and answers grow with the run, all else does not: without it a camera may run for
  /// months.
  enum class FrameList : uint8_t { kKept, kLeftOut };
  explicit RunStats(FrameList list) : list_(list) {}

  void on_frame(const FrameReport& report) override;
  void on_dropped(const DroppedReport& report) override;
  void on_undecodable(const UndecodableReport& report) override;
  void on_seed_reply(const SeedReply& reply) override;
  void on_offer_replies(const std::vector<OfferReply>& replies) override;
  void on_relocalization_answer(const PlaceReport& report) override;

  /// The JSON of client/app/REFERENCE.md. Percentiles of stages are over tracked frames; those
  /// of starting and lost ones stand beside them. `first_map_frame`, of all frames
  /// of the source from 0, is the first that had a map to be tracked in, whether it was or not; null without
  /// a map. An undecodable frame is listed as dropped, with the stamp of the frame before it (its own is not
  /// known). `summary` has what the contract does not ask for.
  [[nodiscard]] std::string to_json(uint64_t bytes_sent, uint64_t bytes_received) const;

  void note_rig(RigSummary rig) { rig_ = std::move(rig); }
  void note_images(ImageSummary images) { images_ = images; }

  /// The last words on stderr, one line each: frames and maps, times, keyframes.
  [[nodiscard]] std::vector<std::string> summary_lines() const;

  /// Why the poses of this run are not what was asked for: no frame was tracked (`why_no_map` is the reason
  /// as far as it was told), or most were dropped. Nothing where they are.
  [[nodiscard]] std::optional<std::string> shortfall(const std::string& why_no_map) const;

  [[nodiscard]] size_t frames_total() const { return frames_total_; }
  [[nodiscard]] size_t frames_decoded() const { return frames_total_ - undecodable_; }
  [[nodiscard]] std::optional<size_t> first_map_frame() const { return first_map_frame_; }

 private:
  struct FrameRow {
    Timestamp time;
    FrameState state = FrameState::kDropped;
    MapId map;
    int inliers = 0;
    int attempted = 0;
    double cpu_ms = 0;
    double wall_ms = 0;
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< map_from_camera, of kRotation
  };

  struct AnswerRow {
    Timestamp asked;
    RelocalizationVerdict verdict = RelocalizationVerdict::kNotKnown;
    MapId map;  ///< of the best place; none: no place
    bool tried = false;
  };

  void add(const FrameRow& row);
  void note_new_points(const MapSnapshot& snapshot, Timestamp now);
  [[nodiscard]] size_t count(FrameState state) const { return counts_[static_cast<size_t>(state)]; }
  [[nodiscard]] size_t tracked() const { return count(FrameState::kTracking) + count(FrameState::kPoor); }
  [[nodiscard]] double tracked_share() const;
  [[nodiscard]] double on_time_share() const;

  const FrameList list_;
  std::optional<RigSummary> rig_;
  std::optional<ImageSummary> images_;
  std::vector<FrameRow> frames_;
  std::vector<AnswerRow> answers_;
  size_t frames_total_ = 0;
  std::array<size_t, 6> counts_{};  ///< by FrameState
  size_t on_time_ = 0;
  Timestamp last_time_;
  std::array<Histogram, kStageCount + 1> stage_ms_;  ///< of tracked frames; the last is the whole frame
  Histogram starting_ms_;                            ///< processor time of frames without a map,
  Histogram lost_ms_;                                ///< and of those lost in one
  std::optional<size_t> first_map_frame_;
  MapId current_map_;
  size_t switches_ = 0;
  size_t undecodable_ = 0;
  size_t seeds_refused_ = 0;
  size_t offers_accepted_ = 0;
  size_t offers_refused_ = 0;
  size_t offers_kept_aside_ = 0;
  size_t map_points_ = 0;
  size_t map_keyframes_ = 0;
  /// Accepted keyframes whose points are not in the replica yet: which, and when they were taken.
  std::vector<std::pair<KeyframeId, Timestamp>> awaited_;
  Revision looked_through_;  ///< for points of them; none: the next
  Histogram points_after_ms_;
  double squared_error_sum_ = 0;  ///< [px^2] of the inliers of tracked frames
  size_t inlier_sum_ = 0;
};

}  // namespace cairn
