// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/tracking/frame_result.h"
#include "client/tracking/patch_flow.h"
#include "common/geometry/camera.h"
#include "common/geometry/multi_view.h"
#include "common/geometry/two_view.h"
#include "common/image/frame_images.h"
#include "common/image/patch.h"

namespace cairn {

struct TrailOptions {
  int count = 1000;                ///< trails begun in the first frame (PTAM r114)
  int cell = 32;                   ///< [px] of the grid over which they are spread
  int barrier = 10;                ///< [grey levels] of FAST's score (PTAM r114), and
  float texture = 70.0F;           ///< Shi-Tomasi's measure of corners where trails begin (PTAM r114)
  int low_barrier = 6;             ///< [grey levels] of corners in an image poor in texture, and
  float low_texture = 20.0F;       ///< Shi-Tomasi's measure of these
  uint64_t fewest = 60;            ///< trails; fewer are not worth following
  float fewest_share = 0.2F;       ///< of those begun: below, what is left covers too little of the view
  float fewest_movement = 0.006F;  ///< of the image width: median movement before the first two-view test
  float more_movement = 1.15F;     ///< factor of movement between two-view tests
  float view_step = 1.0F;          ///< [px] of median movement between remembered views, at first
  uint64_t most_views = 64;        ///< views remembered: where the trails were in a frame
  float match_sigma = 0.7F;        ///< [px] of a sub-pixel trail
  float most_drift = 2.0F;         ///< [px] what matching with the first patch may correct
  int match_iterations = 10;       ///< of that alignment
  uint64_t most_remembered = 300;  ///< trails looked for in views on the way
  uint64_t most_judged = 200;      ///< of those found in all of them
  uint64_t fewest_judged = 40;     ///< as of the matches of a pair (TwoViewOptions)
  double max_depth_sigma = 0.05;   ///< of the depths in the median, over themselves: known to a twentieth
  double max_direction_sigma = 1.5 * M_PI / 180;  ///< [rad] of the baseline: more bends the map
  PatchFlowOptions patches;
};

/// Follows corners of a first frame until two frames are far enough apart to make a map (PTAM 2007,
/// section 6.1, without the key presses): frame to frame with a backward check, and the two-view tests of
/// common/geometry when the image has moved enough. Pure; one thread.
class TrailFollower {
 public:
  /// `seed` of random choices.
  TrailFollower(CameraPtr camera, uint64_t seed, const TrailOptions& options);

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
  /// The server's answer that names the map which is awaited; nothing while none is.
  [[nodiscard]] const std::optional<SeedAnswer>& awaited() const { return awaited_; }
  /// Whether a proposal awaits its verdict, or its map.
  [[nodiscard]] bool is_undecided() const { return undecided_; }
  /// Forgets all trails; the next frame is a first frame.
  void restart();

  /// When the first frame of the trails was taken.
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
    /// The patch that the first frame showed there.
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
  [[nodiscard]] std::optional<Eigen::Vector2f> match_first_patch(const FollowedTrail& trail, int level,
                                                                 const Warp& warp,
                                                                 const FrameImages& now) const;
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
  uint64_t seed_;
  TrailOptions options_;
  std::vector<FollowedTrail> trails_;
  size_t begun_with_ = 0;
  uint64_t next_id_ = 1;
  GrayImagePtr first_image_;
  Timestamp first_time_;
  std::vector<Eigen::Vector2f> matched_;  ///< of this frame, as far as they have been looked for
  std::vector<float> way_;       ///< [px] median movement at the frames whose positions the trails keep
  float movement_ = 0;           ///< [px] median of the trails, in the latest frame
  float tried_at_movement_ = 0;  ///< [px] median movement at the last two-view test
  float view_step_ = 0;          ///< [px] of median movement between these
  bool undecided_ = false;
  std::optional<SeedAnswer> awaited_;
  std::string note_;
};

}  // namespace cairn
