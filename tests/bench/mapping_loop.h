// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "client/capture/frame_source.h"
#include "client/tracking/tracker.h"
#include "common/map/relocalization_answer.h"
#include "server/mapping/map_maker.h"
#include "server/mapping/map_record.h"
#include "server/relocalization/place_index.h"

namespace cairn {

/// Hears what happens while a map is made, in order. Times are CPU time of the thread [ms].
class MappingObserver {
 public:
  virtual ~MappingObserver() = default;
  /// Called before anything is done about the result.
  virtual void on_frame(const Frame&, const FrameResult&, double /*ms*/) {}
  virtual void on_answer(const RelocalizationAnswer&) {}
  /// Called when the map's first work is done, or the seed was refused; `ms`: of the start alone.
  virtual void on_seed(const Frame&, const SeedProposal&, const Result<SeedResult>&, double /*ms*/) {}
  virtual void on_keyframe(const Frame&, const KeyframeDecision&, double /*ms*/) {}
  virtual void on_work(const StepReport&, double /*ms*/) {}
  /// Called with what self-calibration has estimated of a camera that began with a prior.
  virtual void on_camera(const CameraEstimate&) {}
};

/// Does all work that a map has left, to its end; nothing stops or yields.
void finish_work(MapMaker* maker, bool local_only, MappingObserver* observer);

/// The hypothesis that a tracker is told of an answer: the best place, if it is confirmed.
[[nodiscard]] std::optional<PoseHypothesis> hypothesis_of(const RelocalizationAnswer& answer);

struct MappingOptions {
  MapId map;
  uint64_t seed = 1;  ///< of every random choice
  Adjuster adjuster = Adjuster::kOwn;
  bool local_only = false;              ///< no global adjustment
  std::optional<CameraPrior> prior;     ///< about the camera; none: it is known
  double cut_from = 0;                  ///< [s] of the recording: from then on the map maker hears nothing,
  double cut_to = 0;                    ///< [s] and here all that it was to hear, in order
  ImuStream* imu = nullptr;             ///< of the camera; none
  bool ask = true;                      ///< a tracker that is lost in the map may ask the relocalizer
  StageProbe* probe = nullptr;          ///< outlives the loop, as does
  MappingObserver* observer = nullptr;  ///< none
};

/// Tracker, map maker and relocalizer in one thread without DDS: every unit of map work is finished and every
/// query answered before the next frame, as in lockstep.
class MappingLoop {
 public:
  MappingLoop(CameraPtr camera, const MappingOptions& options);

  void frame(const Frame& frame);

  /// The map maker; null without a map.
  [[nodiscard]] const MapMaker* maker() const { return maker_.get(); }
  [[nodiscard]] const MapSnapshotPtr& snapshot() const { return snapshot_; }
  /// The record of all of the map. Precondition: there is one.
  [[nodiscard]] MapRecord record();
  /// The map as the relocalizer has it indexed; null without one.
  [[nodiscard]] IndexedMapPtr indexed() const {
    return index_.maps().empty() ? nullptr : index_.maps().front();
  }

 private:
  void answer(const PlaceView& view);
  void seed(const SeedProposal& proposal, const Frame& frame);
  void take_in(const KeyframeProposal& proposal, const Frame& frame);
  [[nodiscard]] bool is_cut(Timestamp time) const;
  void work();
  void use(const CameraEstimate& estimate);

  CameraPtr camera_;
  MappingOptions options_;
  MapMakerOptions maker_options_;
  MappingObserver silent_;
  MappingObserver& observer_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<MapMaker> maker_;
  MapSnapshotPtr snapshot_;
  std::vector<ImuSample> samples_;  ///< of a frame
  std::optional<Timestamp> began_;  ///< the recording
  std::vector<std::pair<KeyframeProposal, Frame>> held_back_;
  /// Pose of a proposal in the map, relative to a keyframe.
  struct Link {
    KeyframeId keyframe;
    SE3 camera_from_keyframe;
  };
  std::map<uint64_t, Link> chain_;  ///< by number
  PlaceIndex index_;                ///< of this map alone
};

}  // namespace cairn
