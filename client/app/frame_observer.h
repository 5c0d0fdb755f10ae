// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "client/app/ports.h"
#include "client/capture/frame_source.h"

namespace cairn {

/// What became of a frame of the source, as files and the screen name it. kRotation: how the camera has
/// turned since it left what its map shows is known, its position is not.
enum class FrameState : uint8_t { kStarting, kTracking, kPoor, kLost, kDropped, kRotation };
[[nodiscard]] const char* to_string(FrameState state);
/// Whether a pose was measured.
[[nodiscard]] inline bool is_tracked(FrameState state) {
  return state == FrameState::kTracking || state == FrameState::kPoor;
}

constexpr size_t kStageCount = static_cast<size_t>(Stage::kCount);
using StageTimes = std::array<std::chrono::nanoseconds, kStageCount>;

/// A frame that went through the tracker. References are valid during the call only.
struct FrameReport {
  size_t number = 0;  ///< of all frames of the source, from 0
  const Frame& frame;
  const FrameResult& result;
  FrameState state = FrameState::kStarting;
  const MapSnapshotPtr& snapshot;  ///< what it was tracked on; may be null
  const LabelListPtr& labels;      ///< of result.map; may be null
  const SessionStatus& status;
  const StageTimes& stages;         ///< processor time
  std::chrono::nanoseconds cpu{};   ///< processor time of all work on the frame
  std::chrono::nanoseconds wall{};  ///< from when the frame was due (realtime) or taken up to its pose
  CameraPtr camera;      ///< it was tracked with, calibrated since the start; null: as at the start
  std::string rig = {};  ///< what the rig does that carries the camera, for a person; empty: none
};

struct DroppedReport {
  size_t number = 0;
  Timestamp time;
};
struct UndecodableReport {
  size_t number = 0;
  const std::string& reason;  ///< names the file
};

struct StartOverReport {
  size_t number = 0;
  const std::string& reason;
  bool makes_map = true;
};

/// The server's answer to a relocalization query.
struct PlaceReport {
  size_t number = 0;  ///< of the next frame
  Timestamp asked;    ///< of the frame of the latest query, to which this is the answer
  const RelocalizationAnswer& answer;
  bool tried = false;  ///< its place is to be verified, from the next frame that comes with the map
};

/// Hears what happens in the frame loop, in order, on its thread: must return at once.
class FrameObserver {
 public:
  virtual ~FrameObserver() = default;
  virtual void on_frame(const FrameReport&) {}
  virtual void on_dropped(const DroppedReport&) {}
  virtual void on_undecodable(const UndecodableReport&) {}
  virtual void on_seed_reply(const SeedReply&) {}
  /// The replies to offers that came since the frame before, at least one.
  virtual void on_offer_replies(const std::vector<OfferReply>&) {}
  virtual void on_relocalization_answer(const PlaceReport&) {}
  /// The link to the server is in another state, or its words have changed.
  virtual void on_status(const SessionStatus&) {}
  /// Other values of the camera, with which this frame and those that follow are tracked.
  virtual void on_camera(const CameraUpdate&) {}
  /// Lockstep: the server did not settle; the run goes on without.
  virtual void on_unsettled(size_t /*frame_number*/) {}
  /// The map is left; the next frames begin another, or look for one of the server's.
  virtual void on_start_over(const StartOverReport&) {}
};

}  // namespace cairn
