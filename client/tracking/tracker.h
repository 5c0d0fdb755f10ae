// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "client/inertial/encoder_turns.h"
#include "client/inertial/imu_sample.h"
#include "client/relocalization/pose_hypothesis.h"
#include "client/tracking/frame_result.h"
#include "client/tracking/stage.h"
#include "client/tracking/tracker_options.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/image/image.h"
#include "common/map/snapshot.h"

/// The tracker (PTAM 2007, section 5): (frame, map snapshot) -> pose + quality. Pure: no DDS, no threads, no
/// clock; equal inputs give equal bytes. Used from one thread.
namespace cairn {

/// What a tracker that starts over does where a place is known.
enum class NewMap : uint8_t { kWhereNotKnown, kInAnyCase };

class Tracker {
 public:
  Tracker(const CameraPtr& camera, const TrackerOptions& options);
  ~Tracker();
  Tracker(const Tracker&) = delete;
  Tracker& operator=(const Tracker&) = delete;

  /// Tracks one frame of the camera's size against `map` (null: none yet, trails are followed). A map that
  /// has not come of this tracker's own seed is entered as by a lost camera. `image` is kept as long as a
  /// seed may need it. The result is valid until the next call.
  const FrameResult& track(const GrayImagePtr& image, Timestamp time, const MapSnapshotPtr& map,
                           StageProbe* probe = nullptr);

  /// The camera has an IMU that sits so, as far as is known now; nothing: none, or that is not known. Its
  /// samples come in order of time, each before the frame that needs it (up to the first one after the
  /// frame's time).
  void use_imu(const std::optional<ImuMount>& mount);
  void add_samples(std::span<const ImuSample> samples);
  /// The camera is on a rig, whose encoders say this, likewise: for where the IMU has no samples.
  void add_encoders(std::span<const EncoderSample> samples);

  /// Other values of the same camera, from the next frame on: together with the revision that was made with
  /// them.
  void use_camera(const CameraPtr& camera);

  /// The seed proposed last was accepted: when a snapshot of that map comes, the pose starts from the trails,
  /// which are followed meanwhile.
  void seed_accepted(const SeedAnswer& answer);
  /// The seed proposed last was refused: trails go on, and another proposal comes when the view has changed
  /// enough.
  void seed_refused(const std::string& reason);
  /// Sets whether keyframes are proposed, from the next frame on (TrackerOptions::make_keyframes).
  void make_keyframes(bool wanted);
  /// The server's word on the keyframe proposed under this number: what it has become, or that it was
  /// refused. Until then the tracker maps on by itself.
  void keyframe_answered(uint64_t number, std::optional<KeyframeId> keyframe);
  /// The answer to `reloc_query`: where the camera may be, or that no place is known. Unless start_over()
  /// insists on a new map, a seed is proposed only after a fresh answer of the second kind. The poses of a
  /// hypothesis are published when three frames in a row have verified it; one that was rejected again and
  /// again counts as not known for a while.
  PlaceUse relocalization_answered(const std::optional<PoseHypothesis>& hypothesis);
  /// The query was answered, and not whether the place is known: another may be made.
  void place_left_open();
  /// Forgets the map in use; the next frames start a new one, or find back into one that is known.
  void start_over(NewMap wish);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace cairn
