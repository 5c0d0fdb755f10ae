// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "client/app/frame_observer.h"
#include "client/app/lost_watch.h"
#include "client/app/pacer.h"
#include "client/app/ports.h"
#include "client/app/stats.h"
#include "client/inertial/imu_stream.h"
#include "common/base/result.h"

namespace cairn {

struct FrameLoopOptions {
  Pace pace = Pace::kRealtime;
  int width = 0;  ///< of the calibrated camera [px]; frames of another size cannot be tracked
  int height = 0;
  /// The samples of the camera's IMU; null: it has none. Outlives the loop.
  ImuStream* imu = nullptr;
  bool make_maps = true;  ///< may leave a map in which it stays lost, to begin another
  /// How long, by the frames' stamps, a tracker is lost where no map is known before it begins another map.
  std::chrono::nanoseconds lost_patience = std::chrono::seconds(1);
  std::function<bool()> new_map_requested = [] { return false; };        ///< asked once a frame
  std::function<std::string()> rig_text = [] { return std::string(); };  ///< FrameReport::rig
  /// How long lockstep waits for the server's work on one frame; a global adjustment of a full map takes
  /// seconds.
  std::chrono::milliseconds settle_timeout{120'000};
};

/// Source -> tracker -> session, frame by frame; what comes back from the server is given to the tracker
/// before the next frame. Never waits for the network, except in lockstep. Runs on the caller's thread.
class FrameLoop {
 public:
  /// All references must outlive the loop. Observers are called in the order given.
  FrameLoop(FrameSource& source, TrackingEngine& tracker, MapLink& link, PaceClock& clock,
            FrameLoopOptions options, std::vector<FrameObserver*> observers);

  /// Runs until a recording ends (true) or `stop_requested` says so (false). Errors: kConfiguration when the
  /// first frame is not of the camera's size, kDamaged when no frame of a recording could be read, kIo when a
  /// live source gives no images any more.
  [[nodiscard]] Result<bool> run(const std::function<bool()>& stop_requested);

  /// Hands the server's replies to the tracker and the observers. run() does so before every frame; for those
  /// that come after the last one.
  void deliver_replies();
  /// Passes on the values of the camera that go with a revision, when they are others than before.
  void take_camera(const MapSnapshotPtr& snapshot);

 private:
  [[nodiscard]] Status handle(TakenFrame&& taken);
  void handle(const DroppedFrame& dropped);
  void handle(const UndecodableFrame& undecodable);
  void observe_status(const SessionStatus& status);
  void deliver_place(const RelocalizationAnswer& answer);
  /// Gives the answer to the tracker: its best place, that there is none, or that it says neither. Returns
  /// whether the tracker will verify the place, whose map is then in use.
  [[nodiscard]] bool try_place(const RelocalizationAnswer& answer);
  void add_samples(Timestamp time);
  void settle_verification(const FrameResult& result);
  /// Whether the tracker should offer keyframes of this map now.
  [[nodiscard]] bool wants_keyframes(const MapSnapshotPtr& snapshot, Timestamp time) const;
  [[nodiscard]] bool send_proposals(const FrameResult& result, const Frame& frame);
  void settle();
  struct StartOver {
    std::string reason;
    NewMap wish = NewMap::kWhereNotKnown;
  };
  /// Why the map in use is to be left; nothing: it is not.
  [[nodiscard]] std::optional<StartOver> reason_to_start_over(const SessionStatus& status,
                                                              FrameState state) const;
  void start_over_if_needed(const SessionStatus& status, FrameState state);
  template <typename Event, typename Report>
  void notify(Event event, const Report& report);

  FrameSource& source_;
  TrackingEngine& tracker_;
  MapLink& link_;
  PaceClock& clock_;
  const FrameLoopOptions options_;
  const std::vector<FrameObserver*> observers_;
  std::function<bool()> stop_requested_ = [] { return false; };  ///< of run()
  StageClock stages_;
  std::vector<ImuSample> samples_;  ///< for a frame, and likewise:
  std::vector<EncoderSample> encoders_;
  std::optional<ImuMount> mount_;  ///< as the tracker knows it
  size_t frames_seen_ = 0;
  size_t frames_tracked_on_ = 0;  ///< given to the tracker
  std::optional<std::string> last_undecodable_;
  std::optional<SessionStatus> last_status_;
  CameraPtr camera_;  ///< FrameReport::camera
  struct Proposed {
    uint64_t number = 0;
    Timestamp time;
    bool is_decided = false;
  };
  std::optional<Proposed> proposed_;  ///< the last keyframe that is to be kept aside
  LostWatch lost_;
  /// Whether a pose was tracked since the tracker started (over). A tracker that was not tracked anywhere yet
  /// has nothing to find again: a hypothesis that did not hold costs a start no patience.
  bool has_tracked_ = false;
  Timestamp asked_;      ///< of the frame of the latest query
  MapId map_to_verify_;  ///< in use because of a hypothesis in it that is not verified yet
  struct VerifiedMap {
    MapId map;
    Epoch epoch;
    Revision revision;
  };
  VerifiedMap verified_;  ///< of the last pose measured since it started (over)
};

}  // namespace cairn
