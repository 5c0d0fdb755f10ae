// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "client/tracking/frame_images.h"
#include "client/tracking/pose_suggestion.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/place.h"
#include "common/map/ids.h"

namespace cairn {

/// The tracker's own memory of where it was: tiny images of frames it tracked well with their poses (Klein
/// and Murray, ECCV 2008, kept at the client), so that a tracker that is lost finds back to where it has been
/// without asking anyone. Poses are kept relative to a keyframe, so they survive adjustments. Bounded: the
/// oldest views go first.
class PlaceMemory {
 public:
  struct View {
    TinyImage tiny;  ///< blur 2.5
    KeyframeId reference;
    SE3 camera_from_reference;
  };

  /// Remembers a frame if its camera is far enough from the views remembered last.
  void remember(const FrameImages& frame, KeyframeId reference, const SE3& camera_from_reference,
                double mean_depth);
  /// The view whose tiny image is nearest to the frame's, with the camera turned as the tiny images say: a
  /// pose relative to the view's reference. `skip` passes over the best ones: successive frames try
  /// successive candidates.
  struct Candidate {
    KeyframeId reference;
    SE3 camera_from_reference;
  };
  [[nodiscard]] std::optional<Candidate> recall(const FrameImages& frame, const Camera& camera,
                                                size_t skip) const;
  void clear() { views_.clear(); }
  [[nodiscard]] size_t size() const { return views_.size(); }

 private:
  std::vector<View> views_;
};

/// The question where the camera is, asked outside, and what comes back (DESIGN 7): one question under way,
/// at most 15 a second in the time of the frames, given up after half a second without an answer.
class PlaceQuestion {
 public:
  /// The frame described, if a question may be asked now; null otherwise.
  [[nodiscard]] std::shared_ptr<const PlaceView> ask(const FrameImages& frame, Timestamp time);
  /// The answer: a place to try, or nothing.
  void answered(const std::optional<PoseSuggestion>& suggestion);
  /// The suggestion, to be tried once: camera_from_reference of the present frame, turned since the question
  /// as the tiny images say.
  [[nodiscard]] std::optional<PoseSuggestion> take(const FrameImages& frame, const Camera& camera);
  [[nodiscard]] const std::optional<PoseSuggestion>& suggestion() const { return suggestion_; }
  void clear() { *this = PlaceQuestion(); }

 private:
  std::optional<Timestamp> asked_;  ///< when the latest question was asked
  bool under_way_ = false;
  TinyImage tiny_;  ///< of the frame asked about, blur of the place images; empty: none
  std::optional<PoseSuggestion> suggestion_;
};

}  // namespace cairn
