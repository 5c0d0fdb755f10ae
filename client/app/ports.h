// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <span>
#include <vector>

#include "client/session/session.h"
#include "client/tracking/tracker.h"

/// Interfaces to all that the frame loop needs of the world, so that its rules are tested with scripted
/// trackers, servers and clocks. The real ones are in adapters.h and forward word for word: see Tracker and
/// Session for the meaning of each call.
namespace cairn {

class TrackingEngine {
 public:
  virtual ~TrackingEngine() = default;
  virtual const FrameResult& track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                                   StageProbe* probe) = 0;
  virtual void use_imu(const std::optional<ImuMount>& mount) = 0;
  virtual void add_samples(std::span<const ImuSample> samples) = 0;
  virtual void add_encoders(std::span<const EncoderSample> samples) = 0;
  virtual void seed_accepted(const SeedAnswer& answer) = 0;
  virtual void seed_refused(const std::string& reason) = 0;
  [[nodiscard]] virtual PlaceUse relocalization_answered(const std::optional<PoseHypothesis>& hypothesis) = 0;
  virtual void place_left_open() = 0;
  virtual void keyframe_answered(uint64_t number, std::optional<KeyframeId> keyframe) = 0;
  virtual void start_over(NewMap wish) = 0;
  virtual void use_camera(const CameraPtr& camera) = 0;
  virtual void make_keyframes(bool wanted) = 0;
};

class MapLink {
 public:
  virtual ~MapLink() = default;
  [[nodiscard]] virtual MapSnapshotPtr snapshot() const = 0;
  virtual void use_map(MapId map, Epoch epoch, Revision revision) = 0;
  virtual void leave_map() = 0;
  [[nodiscard]] virtual KeyframeUse keyframe_use(MapId map) const = 0;
  virtual void send_seed(SeedProposal proposal) = 0;
  virtual void send_offer(KeyframeProposal proposal, GrayImagePtr image, Timestamp time) = 0;
  virtual void send_query(std::shared_ptr<const PlaceView> view, Timestamp time) = 0;
  virtual void publish_state(const FrameResult& result, Timestamp time) = 0;
  [[nodiscard]] virtual std::optional<SeedReply> take_seed_reply() = 0;
  [[nodiscard]] virtual std::vector<OfferReply> take_offer_replies() = 0;
  [[nodiscard]] virtual std::optional<RelocalizationAnswer> take_relocalization_answer() = 0;
  [[nodiscard]] virtual LabelListPtr labels(MapId map) const = 0;
  [[nodiscard]] virtual std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& snapshot) = 0;
  [[nodiscard]] virtual SessionStatus status() const = 0;
  [[nodiscard]] virtual bool wait_until_settled(std::chrono::milliseconds timeout) = 0;
};

/// A monotonic clock that can be waited on.
class PaceClock {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  virtual ~PaceClock() = default;
  [[nodiscard]] virtual TimePoint now() const = 0;
  virtual void sleep_until(TimePoint time) = 0;
};

}  // namespace cairn
