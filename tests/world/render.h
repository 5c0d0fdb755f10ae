// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "tests/world/scenario.h"
#include "tests/world/tile_kernel.h"

namespace cairn {

/// camera_from_map as a function of the time [s] from the middle of the exposure of the middle row.
using CameraPath = std::function<SE3(double seconds)>;

struct Exposure {
  double shutter = 0;      ///< s that each row is exposed; motion blur
  double readout = 0;      ///< s from the first row to the last; rolling shutter
  double gain = 1;         ///< on the scene's brightness, before noise
  double noise_sigma = 0;  ///< grey levels, Gaussian, independent per pixel
  uint64_t noise_key = 0;  ///< decides the noise
};

/// Renders a scenario as its camera sees it. Pixels are exactly where Camera::project says; each is the mean
/// of several samples, spread over its area and the time that the shutter is open. The same bytes for the
/// same input on every x86-64 machine. One per thread; the scenario must outlive it.
class Renderer {
 public:
  explicit Renderer(const Scenario& scenario);

  /// Renders one frame of the camera's size into `image`, reusing its memory.
  void render(const CameraPath& camera_from_map, const Exposure& exposure, GrayImage* image);

 private:
  struct Tile {
    TileRays rays;
    IdealBox box;  ///< of the rays, with room for shifts within the pixel
    RayShift per_pixel_x;
    RayShift per_pixel_y;
  };
  /// One moment of the exposure, with the places within the pixel that are looked at then.
  struct Sample {
    double seconds = 0;
    Eigen::Array2d shading = Eigen::Array2d::Zero();  ///< from the pixel's centre
    std::vector<Eigen::Array2d> coverage;             ///< likewise
  };
  struct VisibleFace {
    IdealBox bounds;
    float nearest = 0;  ///< inverse depth
    const ProjectedFace* face = nullptr;
  };
  /// The faces in view, as one sample sees them.
  struct View {
    std::vector<ProjectedFace> faces;
    std::vector<VisibleFace> near_to_far;
  };
  struct TileBin {
    std::vector<TileFace> faces;
    const ProjectedFace* occluder = nullptr;  ///< covers the whole tile
  };

  void make_tiles();
  [[nodiscard]] double image_motion(const SE3& begin_from_map, const SE3& end_from_map) const;
  void plan_samples(const CameraPath& camera_from_map, double shutter);
  void project_faces(const SE3& camera_from_map, View* view) const;
  void project_views(const CameraPath& camera_from_map, double row_seconds);
  static void bin_face(const VisibleFace& visible, const IdealBox& box, TileBin* bin);
  void fill_bins(int tile_row);
  void sample_tile(const Tile& tile, size_t column, TileSum* sum) const;
  void develop_row(int tile_row, const Exposure& exposure, GrayImage* image) const;

  const Scenario& scenario_;
  const TileKernels& kernels_;
  SamplingParameters sampling_;
  int columns_ = 0;  ///< tiles side by side
  int rows_ = 0;
  std::vector<Tile> tiles_;
  std::vector<IdealBox> row_boxes_;
  IdealBox view_;
  std::vector<Eigen::Vector3d> landmarks_;  ///< centres of faces, to measure image motion

  // Kept between frames for their memory only.
  std::vector<Sample> samples_;
  std::vector<View> views_;    ///< sample by sample
  std::vector<TileBin> bins_;  ///< of one row of tiles, sample by sample
  std::vector<TileSum> sums_;
};

}  // namespace cairn
