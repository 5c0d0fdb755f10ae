// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "client/tracking/point_search.h"
#include "client/tracking/pose_judgement.h"
#include "client/tracking/provisional_points.h"
#include "common/geometry/se3.h"
#include "common/image/frame_images.h"
#include "common/map/snapshot.h"

namespace cairn {

/// Frames without the map: corners hold the rotation for so long, and the position, whose errors add up from
/// frame to frame.
struct DeadReckoningOptions {
  int rotation_held = 150;  ///< [frames]
  int position_held = 15;   ///< [frames]
  /// [frames] in a row without a corner followed, for which the small images are believed: they err by some
  /// hundredths of the turn.
  int blind = 3;
  /// [rad] Sigma of a turn by the small images; likewise of the position [map unit].
  double blind_sigma = 0.003;  ///< [rad], and over the depth
  float same_turn = 0.9F;      ///< least correlation of two small images whose turn is believed
};

/// Tells where a camera is while its map is out of sight: by the corners that it followed when it knew where
/// it was (Pirchheim, Schmalstieg and Reitmayr, ISMAR 2013), and for a few frames by the turn alone that the
/// gyro or the small images tell. Errors add up, so how long it is believed is bounded. Pure; one thread.
class DeadReckoning {
 public:
  /// `corners` belong to the caller, who follows them in frames that show the map, too. They outlive this.
  DeadReckoning(ProvisionalPoints* corners, const DeadReckoningOptions& options,
                const PoseJudgementOptions& judgement)
      : corners_(*corners), options_(options), judgement_(judgement) {}

  /// The map was seen, or is another.
  void seen() { frames_ = blind_frames_ = 0; }
  /// Whether dead reckoning has gone on for as long as it may.
  [[nodiscard]] bool is_over() const { return frames_ >= options_.rotation_held; }

  /// [map unit] of what the camera looked at when the map was seen last.
  struct Depths {
    double mean = 1;
    double near = 1;
  };
  struct Reckoned {
    SE3 camera_from_map;
    bool is_position_known = false;  ///< else only the rotation is
  };
  /// The pose by the corners found again in the frame and by `map_points`, those of the map that were found
  /// where it looks. Nothing where they do not say how the camera turned.
  [[nodiscard]] std::optional<Reckoned> by_corners(const FrameImages& now, const SE3& expected,
                                                   std::span<const VisiblePoint> map_points,
                                                   const Depths& depths, const MapSnapshot& map);

  /// Goes on to `camera_from_map`, which the turn of the gyro alone gives from a pose reckoned before or
  /// measured. `sigma` of the turn [rad], and of the position over
  /// `mean_depth` [map unit].
  void follow_turn(const FrameImages& now, const SE3& camera_from_map, double sigma, double mean_depth,
                   const MapSnapshot& map);
  /// Goes on likewise by the small images' turn. `likeness` is how alike they are, the motion undone. False,
  /// and nothing is done, where no frame has been reckoned since the map was seen, where they are too unlike,
  /// and after so many blind frames that they may not be believed any longer.
  [[nodiscard]] bool follow_small_images(const FrameImages& now, const SE3& camera_from_map, float likeness,
                                         double mean_depth, const MapSnapshot& map);

 private:
  ProvisionalPoints& corners_;
  DeadReckoningOptions options_;
  PoseJudgementOptions judgement_;
  int frames_ = 0;        ///< since the map was seen
  int blind_frames_ = 0;  ///< since a corner was followed
};

}  // namespace cairn
