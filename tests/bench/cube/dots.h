// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/base/result.h"
#include "common/image/image.h"

/// The dotted box of visp-images-data's `cube` sequence: white dots on black, on the perimeters of a 4x4 grid
/// (top) and of two 4x3 grids (front and left side).
namespace cairn::cube {

enum class Face { kTop, kFront, kLeft };

/// Columns run to the right of the image on top and front and down the image on the left face; rows run
/// down the image on top and away from the top face on the sides.
struct Dot {
  Face face = Face::kTop;
  int column = 0;
  int row = 0;
  bool operator==(const Dot&) const = default;
};

[[nodiscard]] int columns(Face face);
[[nodiscard]] int rows(Face face);
/// The dots of a face, row-major: those of the perimeter only.
[[nodiscard]] std::vector<Dot> dots_of(Face face);

struct DotSighting {
  int frame = 0;
  Dot dot;
  /// Centroid of the dot's light [px]: the centre of the ellipse, which is not the image of the dot's centre.
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

/// Grey-weighted centroid of the bright blob at `near` (within 2.5 px of it), or nothing where there is no
/// blob of a dot's kind: bright on dark, closed, wholly inside.
[[nodiscard]] Result<Eigen::Vector2d> dot_centroid(const GrayView& image, const Eigen::Vector2d& near);

/// Homography, last entry 1, that takes `from` to `to` (at least four, no three of the first four in line):
/// least squares on the linear equations.
[[nodiscard]] Eigen::Matrix3d fit_homography(const std::vector<Eigen::Vector2d>& from,
                                             const std::vector<Eigen::Vector2d>& to);

/// Finds and follows all dots through the sequence: the top face from its place in frame 0 on, the sides back
/// from their places in frame 79. Error kDamaged when fewer than 80 frames of 384x288 are given, or when the
/// top face is not seen whole in every one of them.
[[nodiscard]] Result<std::vector<DotSighting>> follow_dots(const std::vector<GrayImage>& frames);

/// Mean motion [px] of the dots that two frames share; zero if none.
[[nodiscard]] Eigen::Vector2d mean_motion(const std::vector<DotSighting>& from,
                                          const std::vector<DotSighting>& to);

/// The frames in which the camera has moved: those in which the dots lie, in the mean, at least `min_motion`
/// px from where they were in the last one taken. A standing camera repeats its errors and adds nothing.
[[nodiscard]] std::vector<int> moving_frames(const std::vector<DotSighting>& sightings,
                                             double min_motion = 0.2);

}  // namespace cairn::cube
