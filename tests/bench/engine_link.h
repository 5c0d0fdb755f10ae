// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "client/app/ports.h"
#include "server/relocalization/relocalizer.h"

namespace cairn {

/// A server of finished maps behind the port of cairn-track's frame loop, in one process without DDS: a
/// query is answered and a map's replica is there as soon as the loop waits for it, as in lockstep. Seeds
/// and keyframes are not for it: its trackers must be readers.
class EngineLink final : public MapLink {
 public:
  /// `index` outlives the link.
  EngineLink(const PlaceIndex& index, CameraPtr camera, const RelocOptions& options = {})
      : index_(index), camera_(std::move(camera)), options_(options) {
    status_.link = ServerLink::kConnected;
  }

  MapSnapshotPtr snapshot() const override { return held_; }
  void use_map(MapId map, Epoch epoch, Revision revision) override;
  void leave_map() override { held_.reset(); }
  KeyframeUse keyframe_use(MapId /*map*/) const override { return KeyframeUse::kNothing; }
  void send_seed(SeedProposal /*proposal*/) override {}
  void send_offer(KeyframeProposal /*proposal*/, GrayImagePtr /*image*/, Timestamp /*time*/) override {}
  void send_query(std::shared_ptr<const PlaceView> view, Timestamp /*time*/) override {
    asked_ = std::move(view);
  }
  void publish_state(const FrameResult& /*result*/, Timestamp /*time*/) override {}
  std::optional<SeedReply> take_seed_reply() override { return std::nullopt; }
  std::vector<OfferReply> take_offer_replies() override { return {}; }
  std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& /*snapshot*/) override {
    return std::nullopt;
  }
  std::optional<RelocalizationAnswer> take_relocalization_answer() override {
    return std::exchange(answer_, std::nullopt);
  }
  LabelListPtr labels(MapId /*map*/) const override { return nullptr; }
  SessionStatus status() const override { return status_; }
  bool wait_until_settled(std::chrono::milliseconds timeout) override;

  /// CPU time of each answer [ms].
  [[nodiscard]] const std::vector<double>& answer_ms() const { return answer_ms_; }

 private:
  const PlaceIndex& index_;
  CameraPtr camera_;
  RelocOptions options_;
  SessionStatus status_;
  MapSnapshotPtr held_;
  std::shared_ptr<const PlaceView> asked_;
  std::optional<RelocalizationAnswer> answer_;
  std::vector<double> answer_ms_;
};

}  // namespace cairn
