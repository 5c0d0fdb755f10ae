// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/base/reset_on_move.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/image/still_mask.h"

namespace cairn {

/// The tiny blurred image of PTAM (Klein and Murray, ECCV 2008): pyramid level 3 halved again (40x30 for
/// 640x480), zero mean, Gaussian blur. Blur sigma 2.5 for relocalization, 0.75 for the frame-to-frame
/// rotation prior (PTAM r114).
class TinyImage {
 public:
  TinyImage() = default;
  /// `still` (null: nothing): what stands still in the image is left out of its mean, of the blur and of all
  /// comparisons; the values there are 0.
  TinyImage(const GrayView& level3, float sigma, const StillMask* still = nullptr) {
    assign(level3, sigma, still);
  }
  /// Makes the image anew as the constructor does, in the memory that is there: no allocation after the first
  /// frame of a size.
  void assign(const GrayView& level3, float sigma, const StillMask* still = nullptr);

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool empty() const { return values_.empty(); }
  [[nodiscard]] float at(int x, int y) const { return values_[static_cast<size_t>(y * width_ + x)]; }
  [[nodiscard]] const std::vector<float>& values() const { return values_; }
  /// 1 where a pixel counts, else 0.
  [[nodiscard]] const std::vector<float>& weights() const { return weights_; }
  /// Pixels that count.
  [[nodiscard]] size_t count() const { return count_; }

 private:
  void leave_out(const StillMask& still);
  void subtract_mean();

  std::vector<float> values_;
  std::vector<float> weights_;
  ResetOnMove<size_t> count_;
  ResetOnMove<int> width_;
  ResetOnMove<int> height_;
};

/// Mean squared difference; images of other sizes are infinitely far.
[[nodiscard]] float tiny_difference(const TinyImage& a, const TinyImage& b);

/// Rigid motion in the image plane about the image centre: a pixel at `p` of the reference appears at
/// center + R(angle) * (p - center) + shift of the current image. Tiny pixels, radians.
struct TinyMotion {
  Eigen::Vector2f shift = Eigen::Vector2f::Zero();
  float angle = 0;
  float score = 0;  ///< mean squared difference over the overlap after alignment (mean offset removed)
};

/// Aligns `current` to `reference` by efficient second-order minimization (Benhimane and Malis, IROS 2004)
/// over (x, y, angle, mean offset). PTAM r114.
[[nodiscard]] TinyMotion align_tiny(const TinyImage& reference, const TinyImage& current, int iterations = 6);

/// How alike two tiny images are, the motion between them undone: Pearson's correlation, indifferent to gain
/// and bias; -1 where one of them shows nothing, and for images of other sizes.
[[nodiscard]] float tiny_correlation(const TinyImage& reference, const TinyImage& current,
                                     const TinyMotion& motion);

/// The camera rotation (current_from_reference) that explains a tiny motion, by aligning two points +-5 tiny
/// px from the image centre. `camera` is the full-size camera of both images.
[[nodiscard]] SE3 rotation_from_tiny(const TinyMotion& motion, const Camera& camera, int tiny_width);

}  // namespace cairn
