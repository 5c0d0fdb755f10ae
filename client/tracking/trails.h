// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/tracking/frame_result.h"
#include "client/tracking/tracker_options.h"
#include "common/geometry/camera.h"
#include "common/geometry/multi_view.h"
#include "common/geometry/two_view.h"
#include "common/image/frame_images.h"
#include "common/image/patch.h"

namespace cairn {

/// Follows corners of a first frame until two frames are far enough apart to make a map (PTAM 2007,
/// section 6.1, without the key presses): frame to frame with a backward check, and the two-view tests of
/// common/geometry when the image has moved enough. Pure; one thread.
class TrailFollower {
 public:
  TrailFollower(CameraPtr camera, const TrackerOptions& options);

  /// Other values of the same camera, for the two-view tests from now on.
  void use_camera(CameraPtr camera) { camera_ = std::move(camera); }

  /// Follows the trails into a frame; begins anew there when too few are left. `previous` is the frame
  /// before, `motion` how its tiny image moved to this one's. Both are ignored by the first frame.
  void follow(const GrayImagePtr& image, Timestamp time, const FrameImages& now, const FrameImages& previous,
              const TinyMotion& motion);
  /// A pair of frames that passes the two-view tests, once per enough new movement; none while a proposal is
  /// undecided.
  [[nodiscard]] std::optional<SeedProposal> propose(const GrayImagePtr& image, Timestamp time,
                                                    const FrameImages& now);

  /// The proposal was accepted: the map is awaited, and the trails are followed meanwhile.
  void accepted(const SeedAnswer& answer) { awaited_ = answer; }
  /// The proposal was refused: try again after more movement.
  void refused(const std::string& reason);
  /// What is known of the map that is awaited.
  [[nodiscard]] const std::optional<SeedAnswer>& awaited() const { return awaited_; }
  /// Whether a proposal awaits its verdict, or its map.
  [[nodiscard]] bool is_undecided() const { return undecided_; }
  /// Forgets all trails; the next frame is a first frame.
  void restart();

  /// When their first frame was taken.
  [[nodiscard]] Timestamp begun_at() const { return first_time_; }

  struct Live {
    TrailId id;
    Eigen::Vector2f now = Eigen::Vector2f::Zero();
  };
  [[nodiscard]] std::vector<Live> live() const;
  void lines(std::vector<TrailLine>* out) const;
  /// Why there is no proposal yet, for the status line.
  [[nodiscard]] const std::string& note() const { return note_; }

 private:
  static constexpr int kFirstPatches = 2;  ///< levels
  struct FollowedTrail {
    TrailId id;
    Eigen::Vector2f first = Eigen::Vector2f::Zero();
    Eigen::Vector2f now = Eigen::Vector2f::Zero();
    std::vector<Eigen::Vector2f> path;  ///< one position per entry of way_
    /// What the first frame showed there.
    struct FirstPatch {
      SourcePatch pixels{};
      Eigen::Vector2f aside = Eigen::Vector2f::Zero();  ///< of its centre from the trail [px of its level]
      bool is_whole = false;                            ///< the image reaches so far
    };
    std::array<FirstPatch, kFirstPatches> first_patch{};  ///< by level
  };

  void begin(const GrayImagePtr& image, Timestamp time, const FrameImages& now);
  /// The patches of the first `most` trails, as they were in the first frame, found again in this; NaN where
  /// they are not. Looked for once a frame.
  [[nodiscard]] std::span<const Eigen::Vector2f> match_with_first(const FrameImages& now, size_t most);
  [[nodiscard]] static std::optional<Eigen::Vector2f> match_first_patch(const FollowedTrail& trail, int level,
                                                                        const Warp& warp,
                                                                        const FrameImages& now);
  /// How the image around the trails has turned and stretched since their first frame.
  [[nodiscard]] Warp warp_from_first() const;
  [[nodiscard]] float median_movement() const;
  void remember_way(const FrameImages& now);
  [[nodiscard]] MultiView views_on_the_way(std::span<const Eigen::Vector2f> last) const;
  [[nodiscard]] tl::expected<AdjustedMotion, TwoViewFailure> choose(const TwoViewMotions& motions,
                                                                    const MultiView& views) const;
  [[nodiscard]] tl::expected<TwoViewGeometry, TwoViewFailure> judge(const std::vector<PixelMatch>& matches,
                                                                    const MultiView& views) const;

  CameraPtr camera_;
  TrackerOptions options_;
  std::vector<FollowedTrail> trails_;
  size_t begun_with_ = 0;
  uint64_t next_id_ = 1;
  GrayImagePtr first_image_;
  Timestamp first_time_;
  std::vector<Eigen::Vector2f> matched_;  ///< of this frame, as far as they have been looked for
  std::vector<float> way_;       ///< [px] median movement at the frames whose positions the trails keep
  float movement_ = 0;           ///< [px] median of the trails, in the latest frame
  float tried_at_movement_ = 0;  ///< [px] median movement at the last two-view test
  float way_step_ = 0;           ///< [px] between these
  bool undecided_ = false;
  std::optional<SeedAnswer> awaited_;
  std::string note_;
};

}  // namespace cairn
