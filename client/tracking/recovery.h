// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "client/tracking/frame_images.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
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

}  // namespace cairn
