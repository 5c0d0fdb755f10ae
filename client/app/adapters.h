// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/app/ports.h"

/// The real tracker, session and clock behind the ports of the frame loop.
namespace cairn {

class TrackerAdapter final : public TrackingEngine {
 public:
  TrackerAdapter(const CameraPtr& camera, const TrackerOptions& options) : tracker_(camera, options) {}

  const FrameResult& track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                           StageProbe* probe) override {
    return tracker_.track(image, time, map, probe);
  }
  void use_imu(const std::optional<ImuMount>& mount) override { tracker_.use_imu(mount); }
  void add_samples(std::span<const ImuSample> samples) override { tracker_.add_samples(samples); }
  void add_encoders(std::span<const EncoderSample> samples) override { tracker_.add_encoders(samples); }
  void seed_accepted(const SeedAnswer& answer) override { tracker_.seed_accepted(answer); }
  void seed_refused(const std::string& reason) override { tracker_.seed_refused(reason); }
  PlaceUse relocalization_answered(const std::optional<PoseHypothesis>& hypothesis) override {
    return tracker_.relocalization_answered(hypothesis);
  }
  void keyframe_answered(uint64_t number, std::optional<KeyframeId> keyframe) override {
    tracker_.keyframe_answered(number, keyframe);
  }
  void place_left_open() override { tracker_.place_left_open(); }
  void start_over(NewMap wish) override { tracker_.start_over(wish); }
  void use_camera(const CameraPtr& camera) override { tracker_.use_camera(camera); }
  void make_keyframes(bool wanted) override { tracker_.make_keyframes(wanted); }

 private:
  Tracker tracker_;
};

/// Does not own the session.
class SessionAdapter final : public MapLink {
 public:
  explicit SessionAdapter(Session& session) : session_(session) {}

  MapSnapshotPtr snapshot() const override { return session_.snapshot(); }
  void use_map(MapId map, Epoch epoch, Revision revision) override { session_.use_map(map, epoch, revision); }
  void leave_map() override { session_.leave_map(); }
  KeyframeUse keyframe_use(MapId map) const override { return session_.keyframe_use(map); }
  void send_seed(SeedProposal proposal) override { session_.send_seed(std::move(proposal)); }
  void send_offer(KeyframeProposal proposal, GrayImagePtr image, Timestamp time) override {
    session_.send_offer(std::move(proposal), std::move(image), time);
  }
  void send_query(std::shared_ptr<const PlaceView> view, Timestamp time) override {
    session_.send_query(std::move(view), time);
  }
  void publish_state(const FrameResult& result, Timestamp time) override {
    session_.publish_state(result, time);
  }
  std::optional<SeedReply> take_seed_reply() override { return session_.take_seed_reply(); }
  std::vector<OfferReply> take_offer_replies() override { return session_.take_offer_replies(); }
  std::optional<RelocalizationAnswer> take_relocalization_answer() override {
    return session_.take_relocalization_answer();
  }
  LabelListPtr labels(MapId map) const override { return session_.labels(map); }
  std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& snapshot) override {
    return session_.take_camera(snapshot);
  }
  SessionStatus status() const override { return session_.status(); }
  bool wait_until_settled(std::chrono::milliseconds timeout) override {
    return session_.wait_until_settled(timeout);
  }

 private:
  Session& session_;
};

class SteadyClock final : public PaceClock {
 public:
  TimePoint now() const override { return std::chrono::steady_clock::now(); }
  void sleep_until(TimePoint time) override { std::this_thread::sleep_until(time); }
};

}  // namespace cairn
