// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>

#include "client/tracking/point_search.h"
#include "common/image/frame_images.h"
#include "common/image/smear.h"
#include "common/image/tiny_image.h"
#include "common/map/snapshot.h"

namespace cairn {

struct ExposureOptions {
  double step = 1.0 / 240;    ///< [s] by which an exposure is varied: an eighth of a frame at 30 Hz
  double longest = 1.0 / 15;  ///< [s] of an exposure that is believed
  double kept = 0.95;         ///< of what earlier frames have told, per frame
  float least_smear = 0.5F;   ///< [search-level px] that a step must add for a point to tell anything
  uint64_t most_asked = 200;  ///< points of a frame that are compared, at most; and of these
  int most_telling = 24;      ///< those that tell something: half a microsecond for each template
};

/// How long a camera exposes its frames, estimated from how it smears what the map knows. Starts at 0;
/// follows an automatic exposure within some 20 frames in motion. Takes no memory. Pure; one thread.
class Exposure {
 public:
  explicit Exposure(const ExposureOptions& options) : options_(options) {}

  /// The next frame has come `seconds` after the one before; meanwhile the small images moved by `motion`.
  /// What is known of its smear is noted in it.
  void next_frame(const TinyMotion& motion, double seconds, FrameImages* now);
  /// The points found in the frame of the latest next_frame(), of this map.
  void learn(const FrameImages& now, std::span<const VisiblePoint> points, const MapSnapshot& map);

  [[nodiscard]] double seconds() const { return seconds_; }

 private:
  /// ZMSSD of a point with a shorter exposure, with this one, with a longer one.
  using Misfits = std::array<double, 3>;
  [[nodiscard]] std::optional<Misfits> misfits(const FrameImages& now, const VisiblePoint& point,
                                               const SourcePatch& source, double middle) const;

  ExposureOptions options_;
  double seconds_ = 0;
  double information_ = 0;  ///< curvature of the misfits over the steps, of the latest frames
  Smear step_;              ///< what a step of the exposure adds to the smear of this frame
};

}  // namespace cairn
