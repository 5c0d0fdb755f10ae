// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "common/base/result.h"
#include "common/geometry/se3.h"
#include "tests/bench/cube/dots.h"

/// Focal length by adjustment, from the dotted box (known shape) and from features of the scene (unknown
/// shape).
namespace cairn::cube {

/// Pinhole with one term of radial distortion.
struct CubeCamera {
  double focal = 0;   ///< of columns [px]
  double aspect = 1;  ///< focal length of rows over that of columns
  double cx = 0, cy = 0;
  double k1 = 0;
};

/// Parameters that are estimated besides the focal length.
struct Freedom {
  bool aspect = false;
  bool centre = false;
  bool k1 = false;
  bool side_faces = true;    ///< dots: use the side faces
  bool right_angles = true;  ///< dots: hold the side faces at right angles to the top
};

/// An adjusted camera with the standard deviations of its parameters from the covariance of the adjustment,
/// scaled by the residuals.
struct CameraFit {
  CubeCamera camera;
  CubeCamera sigma;
  std::vector<Eigen::Vector3d> points;  ///< scene: by track
  double scale = 0;                     ///< robust sigma of a coordinate that the loss was scaled by [px]
  double rms = 0;                       ///< weighted, per coordinate [px]
  std::vector<SE3> camera_from_object;  ///< by frame; identity where nothing was seen
  Eigen::Matrix<double, 10, 1> box = Eigen::Matrix<double, 10, 1>::Zero();  ///< dots: see BoxParameter
  /// Length of each observation's residual [px], in the order of the input (of what was used of it).
  std::vector<double> residuals;
};

/// Shape of the box in units of the top face's dot spacing. Object frame: origin in the middle of the top
/// face's dots, x along its columns, y along its rows, z into the box.
enum BoxParameter {
  kRadius,         ///< of a dot
  kFrontDistance,  ///< of the front face's plane along y
  kFrontShift,     ///< of its dots along x
  kFrontDepth,     ///< z of its first row
  kLeftDistance,   ///< of the left face's plane along -x
  kLeftShift,      ///< of its dots along y
  kLeftDepth,      ///< z of its first row
  kSideSpacing,    ///< of the side faces' dots
  kFrontLean,      ///< angle of the front face about x beyond the right one [rad]
  kLeftLean,       ///< the same of the left face, about y
};

/// Pixel of the centre of the ellipse as which a circle appears. `centre`, and two vectors at right angles as
/// long as the radius that span its plane, in the camera's frame. The image is the conic whose dual is
/// H diag(1, 1, -1) H^T with H = [a b centre] (Hartley and Zisserman 2004, 8.2).
template <typename T>
Eigen::Matrix<T, 2, 1> ellipse_centre(const Eigen::Matrix<T, 3, 1>& centre, const Eigen::Matrix<T, 3, 1>& a,
                                      const Eigen::Matrix<T, 3, 1>& b) {
  const auto dual = [&](int i, int j) { return a[i] * a[j] + b[i] * b[j] - centre[i] * centre[j]; };
  return {dual(0, 2) / dual(2, 2), dual(1, 2) / dual(2, 2)};
}

/// Adjusts camera, box and poses to the sightings in two passes. The first, with a Cauchy loss, gives the
/// scale of the residuals; the second, with a loss scaled by it, makes the estimate. `scale` [px], if known
/// from a like problem, saves the first. Error kDegenerate when the sightings do not determine it.
[[nodiscard]] Result<CameraFit> fit_to_dots(const std::vector<DotSighting>& sightings,
                                            const CubeCamera& start, const Freedom& freedom,
                                            double scale = 0);

/// A point of the scene seen in several frames.
struct Track {
  struct Sighting {
    int frame = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  };
  std::vector<Sighting> sightings;
};

/// Start values of an adjustment of tracks; none of them is held but the gauge.
struct SceneStart {
  CubeCamera camera;
  std::vector<SE3> camera_from_object;  ///< by frame
  std::vector<Eigen::Vector3d> points;  ///< by track; empty: triangulated
  double scale = 0;                     ///< as for fit_to_dots()
};

/// Bundle adjustment of tracks with the camera free: poses, points, focal length. Tracks of less than two
/// sightings are passed over. Passes and errors as fit_to_dots(). `residuals`: track by track.
[[nodiscard]] Result<CameraFit> fit_to_tracks(const std::vector<Track>& tracks, const SceneStart& start,
                                              const Freedom& freedom);

/// Standard deviation of an estimate by the delete-one-group jackknife: sqrt((n - 1) / n sum (e_i - mean)^2)
/// over the estimates that leave out group i. Unlike a covariance it knows of errors that the members of a
/// group share.
[[nodiscard]] double jackknife_sigma(const std::vector<double>& estimates);

}  // namespace cairn::cube
