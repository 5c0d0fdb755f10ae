// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "common/image/corners.h"
#include "common/image/pyramid.h"
#include "common/image/still_mask.h"

namespace cairn {

struct StillRegionsOptions {
  int learn_every = 8;      ///< [frames] while one tracks
  int fast_threshold = 10;  ///< [grey levels] (PTAM r114)
  int barrier = 10;         ///< [grey levels] of FAST's score (PTAM r114)
  float texture = 70.0F;    ///< Shi-Tomasi's measure (PTAM r114)
  int square = 40;  ///< [px of level 0] squares in which corners are judged together to have moved or not
  float most_stay = 0.5F;  ///< of the corners of a square that has moved
  /// Squares whose corners have gone, for the camera to have moved; and so many times as many as those whose
  /// corners have stayed, since a hand before a camera at rest moves, too.
  int fewest_moved = 6;
  int moved_by_still = 2;
  int fewest_counted = 8;   ///< [frames] by chance a corner is back within 2 px in one of four
  int most_counted = 16;    ///< [frames] then counting begins anew: a mark may come and go
  int most_looks = 100;     ///< [frames] for the first judgement: a camera that hardly moves tells nothing
  float often_seen = 0.8F;  ///< of the frames counted
  int most_change = 6;      ///< [grey levels of level 3] of what keeps its brightness: noise and JPEG's rings
  /// |sum of gradients|^2 over frames times sum of |gradient|^2; by chance 1 / frames.
  float coherent = 0.5F;
  float rim_gradient = 6;      ///< [grey levels of level 3 over two pixels]
  uint64_t fewest_framed = 8;  ///< [cells] of rim
  int least_mean_change = 2;   ///< [grey levels of level 3] since the last frame counted
  int most_watched = 16;       ///< [grey levels] of a border that has been found
  int least_change = 15;       ///< [grey levels] of most of the image, for that to mean anything
};

/// Finds what stands still in the images of a camera that moves. A camera that moves moves nearly everything
/// it sees: corners that come back at the same pixels in frame after frame while most others are gone belong
/// to a water mark, a notch or a rim; and what lies at the border of the image and keeps its brightness while
/// the rest changes shows nothing of the world. Frames count only when the image has moved since the last
/// that did, so a camera at rest before something that moves masks nothing. Pure; one thread.
class StillRegions {
 public:
  explicit StillRegions(const StillRegionsOptions& options) : options_(options) {}

  /// Looks at a frame while one tracks: it is learnt from every eighth until that is judged, since their
  /// corners cost a millisecond, and the others are watched. Where there `has_time`, since there is nothing
  /// to track, each is learnt from. True when mask() has changed.
  bool look(const Pyramid& frame, bool has_time);
  /// Learns from a frame. True when mask() has changed.
  bool learn(const Pyramid& frame);
  /// Cheap, for every frame: what was taken for a border and changes is none. True when mask() has changed.
  bool watch(const GrayImage& level3);
  /// Whether a whole round of frames was counted, or so many were looked at that none is to be expected. A
  /// first mask may be known before.
  [[nodiscard]] bool has_judged() const { return has_judged_; }
  /// The mask as far as it is known; null: nothing stands still.
  [[nodiscard]] const StillMaskPtr& mask() const { return mask_; }

 private:
  void begin(const GrayImage& level3);
  void mark_corners();
  [[nodiscard]] bool has_changed(const GrayImage& level3) const;
  [[nodiscard]] bool has_moved(const GrayImage& level0) const;
  void count(const GrayImage& level3);
  void count_gradients(const GrayImage& level3);
  [[nodiscard]] bool is_rim(size_t cell) const;
  void find_still_corners();
  void find_border();
  template <typename Passes>
  [[nodiscard]] std::vector<size_t> region_from(size_t start, const Passes& passes,
                                                std::vector<uint8_t>* visited,
                                                std::vector<size_t>* around) const;
  template <typename Passes>
  void add_if_framed(size_t start, const Passes& is_unchanging, std::vector<uint8_t>* visited);
  [[nodiscard]] StillMaskPtr make_mask() const;

  StillRegionsOptions options_;
  StillMaskPtr mask_;
  std::vector<uint8_t> marks_;   ///< cells of the mask in which corners stand still
  std::vector<uint8_t> border_;  ///< cells of the mask that are of the border, and what they look like
  std::vector<uint8_t> border_dark_, border_bright_;
  CornerList fast_;                 ///< of the frame, level 0; no mask applies to them
  std::vector<Candidate> corners_;  ///< the best of them
  bool has_judged_ = false;
  int unlearnt_ = 0;                 ///< frames that were looked at since one was learnt from
  int looks_ = 0;                    ///< at frames whose corners were found
  int frames_ = 0;                   ///< counted since this round of counting began
  int width_ = 0, height_ = 0;       ///< of level 3
  int columns_ = 0, rows_ = 0;       ///< of the grid of corners, cells of 2x2 px
  GrayImage last_;                   ///< level 3 of the last frame counted
  std::vector<uint8_t> had_corner_;  ///< at the last frame counted, in or beside each cell of that grid
  std::vector<uint8_t> seen_;        ///< in how many frames each of them had
  std::vector<uint8_t> darkest_, brightest_;  ///< of each pixel of level 3
  /// Sums over the frames counted, of each of them: gradient, and its square.
  std::vector<float> gradient_x_, gradient_y_, gradient_squared_;
};

}  // namespace cairn
