// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/app/ports.h"
#include "client/capture/frame_source.h"

/// Scripted stand-ins for source, clock, tracker and server: tests only.
namespace cairn::testing {

inline Timestamp at_ms(int64_t ms) {
  return Timestamp{ms * 1'000'000};
}

inline Frame make_frame(uint64_t index, Timestamp time, int width = 64, int height = 48) {
  return {index, time, std::make_shared<const GrayImage>(width, height)};
}

/// Time passes only by sleeping and by pass().
class ManualClock final : public PaceClock {
 public:
  TimePoint now() const override { return now_; }
  void sleep_until(TimePoint time) override { now_ = std::max(now_, time); }
  void pass(std::chrono::nanoseconds duration) { now_ += duration; }

 private:
  TimePoint now_{std::chrono::hours(1)};
};

class ListSource final : public FrameSource {
 public:
  using Item = Result<std::optional<Frame>>;

  explicit ListSource(std::deque<Item> items, bool live = false) : items_(std::move(items)), live_(live) {}

  Item next() override {
    if (items_.empty()) return std::nullopt;
    Item item = std::move(items_.front());
    items_.pop_front();
    return item;
  }
  std::optional<size_t> frame_count() const override { return std::nullopt; }
  std::string describe() const override { return "list"; }
  bool is_live() const override { return live_; }

 private:
  std::deque<Item> items_;
  bool live_;
};

/// `count` frames, `period_ms` apart.
inline std::deque<ListSource::Item> regular_frames(size_t count, int64_t period_ms) {
  std::deque<ListSource::Item> items;
  for (size_t i = 0; i < count; ++i)
    items.emplace_back(make_frame(i, at_ms(static_cast<int64_t>(i) * period_ms)));
  return items;
}

/// Gives the results of `script`, one per frame; notes what it was told.
class ScriptedTracker final : public TrackingEngine {
 public:
  using Step = std::function<void(FrameResult&)>;

  explicit ScriptedTracker(std::vector<Step> script) : script_(std::move(script)) {}

  const FrameResult& track(const GrayImagePtr&, Timestamp time, const MapSnapshotPtr& map,
                           StageProbe* probe) override {
    probe->begin(Stage::kPose);
    if (times.empty()) words_before_first_frame = words.size();
    result_ = FrameResult{};
    if (times.size() < script_.size()) script_[times.size()](result_);
    times.push_back(time);
    snapshots.push_back(map);
    probe->end(Stage::kPose);
    return result_;
  }
  void use_imu(const std::optional<ImuMount>& mount) override {
    words.push_back(mount ? fmt::format("IMU with {} ms", mount->clock_offset.count() / 1'000'000)
                          : "no IMU");
  }
  void add_samples(std::span<const ImuSample> samples) override { sample_counts.push_back(samples.size()); }
  void add_encoders(std::span<const EncoderSample> samples) override { encoder_count += samples.size(); }
  void seed_accepted(const SeedAnswer&) override { words.emplace_back("accepted"); }
  void seed_refused(const std::string& reason) override { words.push_back("refused: " + reason); }
  PlaceUse relocalization_answered(const std::optional<PoseHypothesis>& hypothesis) override {
    words.emplace_back(!hypothesis             ? "place not known"
                       : hypothesis->confirmed ? "try a place"
                                               : "try a place, unconfirmed");
    return hypothesis ? use_of_places : PlaceUse::kNotKnown;
  }
  void keyframe_answered(uint64_t /*number*/, std::optional<KeyframeId> /*keyframe*/) override {}
  void place_left_open() override { words.emplace_back("left open"); }
  void start_over(NewMap wish) override {
    words.emplace_back(wish == NewMap::kInAnyCase ? "start a new map" : "start over");
  }

  void use_camera(const CameraPtr& camera) override {
    words.push_back(fmt::format("camera of {:.0f} px at frame {}", camera->focal_length(), times.size()));
  }

  void make_keyframes(bool wanted) override { keyframes_wanted.push_back(wanted); }

  PlaceUse use_of_places = PlaceUse::kToVerify;
  std::vector<bool> keyframes_wanted;  ///< of each frame

  std::vector<size_t> sample_counts;
  size_t encoder_count = 0;
  std::vector<Timestamp> times;
  std::vector<MapSnapshotPtr> snapshots;
  std::vector<std::string> words;
  size_t words_before_first_frame = 0;

 private:
  std::vector<Step> script_;
  FrameResult result_;
};

/// Notes what is sent; answers what the test puts in.
class ScriptedLink final : public MapLink {
 public:
  MapSnapshotPtr snapshot() const override { return map; }
  void use_map(MapId wanted, Epoch, Revision revision) override {
    sent.push_back(fmt::format("use {} at {}", wanted.bytes[0], revision.value));
  }
  void leave_map() override { sent.emplace_back("leave"); }
  KeyframeUse keyframe_use(MapId) const override { return use_of_keyframes; }
  void send_seed(SeedProposal) override { sent.emplace_back("seed"); }
  void send_offer(KeyframeProposal, GrayImagePtr, Timestamp) override { sent.emplace_back("offer"); }
  void send_query(std::shared_ptr<const PlaceView>, Timestamp) override { sent.emplace_back("query"); }
  void publish_state(const FrameResult&, Timestamp) override { ++states_published; }
  std::optional<SeedReply> take_seed_reply() override { return std::exchange(seed_reply, std::nullopt); }
  std::vector<OfferReply> take_offer_replies() override { return std::exchange(offer_replies, {}); }
  std::optional<RelocalizationAnswer> take_relocalization_answer() override {
    if (always_answer) return always_answer;
    return std::exchange(relocalization_answer, std::nullopt);
  }
  LabelListPtr labels(MapId wanted) const override {
    return map && map->map == wanted ? map_labels : nullptr;
  }
  std::optional<CameraUpdate> take_camera(const MapSnapshotPtr& snapshot) override {
    return std::exchange(snapshot ? camera : first_camera, std::nullopt);
  }
  SessionStatus status() const override { return session_status; }
  bool wait_until_settled(std::chrono::milliseconds) override {
    sent.emplace_back("settle");
    if (const auto act = std::exchange(on_settled, nullptr)) act();
    return settles;
  }

  MapSnapshotPtr map;
  LabelListPtr map_labels;
  std::optional<SeedReply> seed_reply;
  std::vector<OfferReply> offer_replies;
  std::optional<RelocalizationAnswer> relocalization_answer;  ///< once
  std::optional<RelocalizationAnswer> always_answer;          ///< before every frame
  std::optional<CameraUpdate> camera;                         ///< once
  std::optional<CameraUpdate> first_camera;                   ///< likewise, without a map
  std::function<void()> on_settled;                           ///< once
  SessionStatus session_status;
  KeyframeUse use_of_keyframes = KeyframeUse::kKeyframe;
  bool settles = true;
  std::vector<std::string> sent;
  size_t states_published = 0;
};

}  // namespace cairn::testing
