// SPDX-License-Identifier: Apache-2.0
#include "tests/world/render.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr int kMinSamples = 2;          // texture is filtered already
constexpr int kMinCoverageLooks = 4;    // what edges need to look smooth
constexpr int kMaxSamples = 24;         // beyond 24 px of blur nothing is left to alias
constexpr double kBlurPerSample = 1.5;  // px
constexpr double kPixelAperture = 1.0;  // px
// Texels no smaller than pixels: interpolation then weights every point of the texture alike, whatever its
// place between pixel centres, and the image of a pattern keeps its centroid. Costs the sharpness that a real
// lens lacks too.
constexpr float kTextureLevelBias = 0;

/// Fractional part of a low-discrepancy sequence's element, by the multiples of an irrational number.
double fraction_of_multiple(size_t i, double irrational) {
  const double multiple = static_cast<double>(i) * irrational;
  return multiple - std::floor(multiple);
}

/// The R2 sequence (Roberts, 2018): even over the pixel for every count.
Eigen::Array2d place_in_pixel(size_t i) {
  return {fraction_of_multiple(i, 0.7548776662466927), fraction_of_multiple(i, 0.5698402909980532)};
}

/// Moves places so that their mean is the pixel's centre and they are uncorrelated with the times at which
/// they are looked at (mean 0).
void balance(std::span<const double> seconds, std::span<Eigen::Array2d> places) {
  Eigen::Array2d mean = Eigen::Array2d::Zero();
  for (const Eigen::Array2d& place : places) mean += place / static_cast<double>(places.size());
  Eigen::Array2d covariance = Eigen::Array2d::Zero();
  double variance = 0;
  for (size_t i = 0; i < places.size(); ++i) {
    places[i] = kPixelAperture * (places[i] - mean);
    covariance += seconds[i] * places[i];
    variance += seconds[i] * seconds[i];
  }
  if (variance <= 0) return;  // nothing moves
  for (size_t i = 0; i < places.size(); ++i) places[i] -= seconds[i] * covariance / variance;
}

}  // namespace

Renderer::Renderer(const Scenario& scenario)
    : scenario_(scenario),
      kernels_(best_kernels()),
      sampling_{static_cast<float>(1.0 / scenario.camera->focal_length()), kTextureLevelBias} {
  make_tiles();
  for (const Face& face : scenario.faces) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& corner : face.corners) sum += corner;
    landmarks_.push_back(sum / static_cast<double>(face.corners.size()));
  }
}

void Renderer::make_tiles() {
  const Camera& camera = *scenario_.camera;
  columns_ = (camera.width() + kTileWidth - 1) / kTileWidth;
  rows_ = (camera.height() + kTileHeight - 1) / kTileHeight;
  tiles_.resize(static_cast<size_t>(columns_) * static_cast<size_t>(rows_));
  row_boxes_.resize(static_cast<size_t>(rows_));
  sums_.resize(static_cast<size_t>(columns_));
  const auto ideal = [&camera](double x, double y) {
    const Eigen::Vector3d ray = camera.unproject({x, y});
    return Eigen::Vector2f((ray.head<2>() / ray.z()).cast<float>());
  };
  for (size_t index = 0; index < tiles_.size(); ++index) {
    Tile& tile = tiles_[index];
    const int x0 = static_cast<int>(index) % columns_ * kTileWidth;
    const int y0 = static_cast<int>(index) / columns_ * kTileHeight;
    for (int i = 0; i < kTilePixels; ++i) {
      // A tile that overhangs repeats the last pixel; those beyond are never shown.
      const Eigen::Vector2f ray = ideal(std::min(x0 + i % kTileWidth, camera.width() - 1),
                                        std::min(y0 + i / kTileWidth, camera.height() - 1));
      tile.rays.x[static_cast<size_t>(i)] = ray.x();
      tile.rays.y[static_cast<size_t>(i)] = ray.y();
    }
    const double middle_x = std::min(x0 + kTileWidth / 2, camera.width() - 1);
    const double middle_y = std::min(y0 + kTileHeight / 2, camera.height() - 1);
    const Eigen::Vector2f dx = ideal(middle_x + 0.5, middle_y) - ideal(middle_x - 0.5, middle_y);
    const Eigen::Vector2f dy = ideal(middle_x, middle_y + 0.5) - ideal(middle_x, middle_y - 0.5);
    tile.per_pixel_x = {dx.x(), dx.y()};
    tile.per_pixel_y = {dy.x(), dy.y()};
    const auto [left, right] = std::minmax_element(tile.rays.x.begin(), tile.rays.x.end());
    const auto [top, bottom] = std::minmax_element(tile.rays.y.begin(), tile.rays.y.end());
    const float margin = sampling_.ideal_per_pixel;
    tile.box = {*left - margin, *top - margin, *right + margin, *bottom + margin};
    make_blocks(margin, &tile.rays);
    view_ = view_.united(tile.box);
    IdealBox& row_box = row_boxes_[index / static_cast<size_t>(columns_)];
    row_box = index % static_cast<size_t>(columns_) == 0 ? tile.box : row_box.united(tile.box);
  }
}

/// How far [px] the scene moves in the image between two poses: nine tenths of the landmarks in view move
/// less.
double Renderer::image_motion(const SE3& begin_from_map, const SE3& end_from_map) const {
  const Camera& camera = *scenario_.camera;
  std::vector<double> motions;
  for (const Eigen::Vector3d& landmark : landmarks_) {
    const auto begin = camera.project(begin_from_map * landmark);
    if (!begin || !camera.in_image(*begin)) continue;
    const auto end = camera.project(end_from_map * landmark);
    if (end) motions.push_back((*end - *begin).norm());
  }
  if (motions.empty()) return 0;
  const auto rank = motions.begin() + static_cast<std::ptrdiff_t>(motions.size() * 9 / 10);
  std::nth_element(motions.begin(), rank, motions.end());
  return *rank;
}

/// Places samples over the pixel and the shutter time so that mean place and mean time are the pixel's centre
/// and the middle of the exposure exactly, the variance in time is that of an even exposure, and place and
/// time are uncorrelated. More blur takes more samples; where there are few, each looks at faces twice.
void Renderer::plan_samples(const CameraPath& camera_from_map, double shutter) {
  const double blur =
      shutter <= 0 ? 0 : image_motion(camera_from_map(-0.5 * shutter), camera_from_map(0.5 * shutter));
  const int count =
      std::max(std::min(static_cast<int>(std::ceil(blur / kBlurPerSample)), kMaxSamples), kMinSamples);
  const size_t looks = count < kMinCoverageLooks ? kMaxCoverageShifts : 1;
  const double time_scale = shutter / std::sqrt(1.0 - 1.0 / (static_cast<double>(count) * count));
  std::vector<double> times;
  std::vector<double> look_times;
  std::vector<Eigen::Array2d> shading;
  std::vector<Eigen::Array2d> coverage;
  for (int i = 0; i < count; ++i) {
    times.push_back(time_scale * ((i + 0.5) / count - 0.5));
    shading.push_back(place_in_pixel(shading.size()));
    for (size_t look = 0; look < looks; ++look) {
      look_times.push_back(times.back());
      coverage.push_back(place_in_pixel(coverage.size()));
    }
  }
  balance(times, shading);
  balance(look_times, coverage);
  samples_.resize(times.size());
  views_.resize(times.size());
  for (size_t i = 0; i < samples_.size(); ++i) {
    const auto first = coverage.begin() + static_cast<std::ptrdiff_t>(i * looks);
    samples_[i] = {times[i], shading[i], {first, first + static_cast<std::ptrdiff_t>(looks)}};
  }
}

/// The faces in view, near ones first, so that they hide the far ones before those are looked at.
void Renderer::project_faces(const SE3& camera_from_map, View* view) const {
  view->faces.clear();
  for (const Face& face : scenario_.faces) {
    auto projected =
        project_face(face, scenario_.textures[static_cast<size_t>(face.texture)], camera_from_map, view_);
    if (projected) view->faces.push_back(*projected);
  }
  view->near_to_far.clear();
  for (const ProjectedFace& face : view->faces)
    view->near_to_far.push_back({face.bounds, face.nearest, &face});
  std::ranges::stable_sort(view->near_to_far, std::greater{}, &VisibleFace::nearest);
}

void Renderer::project_views(const CameraPath& camera_from_map, double row_seconds) {
  for (size_t i = 0; i < samples_.size(); ++i) {
    project_faces(camera_from_map(row_seconds + samples_[i].seconds), &views_[i]);
  }
}

/// Adds a face to what may show in a tile, unless it is outside or hidden; takes out what it hides.
void Renderer::bin_face(const VisibleFace& visible, const IdealBox& box, TileBin* bin) {
  const ProjectedFace& face = *visible.face;
  if (!visible.bounds.overlaps(box) || (bin->occluder != nullptr && hides(box, *bin->occluder, face))) return;
  uint32_t crossing = 0;
  for (int edge = 0; edge < face.edge_count; ++edge) {
    const LinearFunction& f = face.edges[static_cast<size_t>(edge)];
    if (box.maximum(f) < 0) return;
    if (box.minimum(f) < 0) crossing |= 1U << edge;
  }
  if (crossing == 0) {
    std::erase_if(bin->faces, [&](const TileFace& other) { return hides(box, face, *other.face); });
    bin->occluder = &face;
  }
  bin->faces.push_back({&face, crossing});
}

/// Sorts the faces that the samples see into the tiles of one row.
void Renderer::fill_bins(int tile_row) {
  const auto columns = static_cast<size_t>(columns_);
  const std::span tiles(&tiles_[static_cast<size_t>(tile_row) * columns], columns);
  const IdealBox& row_box = row_boxes_[static_cast<size_t>(tile_row)];
  bins_.resize(views_.size() * columns);
  for (size_t i = 0; i < views_.size(); ++i) {
    const std::span bins(&bins_[i * columns], columns);
    for (TileBin& bin : bins) {
      bin.faces.clear();
      bin.occluder = nullptr;
    }
    for (const VisibleFace& visible : views_[i].near_to_far) {
      if (!visible.bounds.overlaps(row_box)) continue;
      const auto first = std::ranges::partition_point(
          tiles, [&visible](const Tile& tile) { return tile.box.x1 < visible.bounds.x0; });
      for (auto column = static_cast<size_t>(first - tiles.begin());
           column < columns && tiles[column].box.x0 <= visible.bounds.x1; ++column) {
        bin_face(visible, tiles[column].box, &bins[column]);
      }
    }
  }
}

void Renderer::sample_tile(const Tile& tile, size_t column, TileSum* sum) const {
  sum->fill(0);
  const auto shift_of = [&tile](const Eigen::Array2d& place) {
    const Eigen::Array2f pixel = place.cast<float>();
    return RayShift{pixel.x() * tile.per_pixel_x.x + pixel.y() * tile.per_pixel_y.x,
                    pixel.x() * tile.per_pixel_x.y + pixel.y() * tile.per_pixel_y.y};
  };
  std::array<RayShift, kMaxCoverageShifts> coverage;
  for (size_t i = 0; i < samples_.size(); ++i) {
    std::ranges::transform(samples_[i].coverage, coverage.begin(), shift_of);
    const TileSample sample{bins_[i * static_cast<size_t>(columns_) + column].faces,
                            shift_of(samples_[i].shading),
                            {coverage.data(), samples_[i].coverage.size()},
                            1.0F / static_cast<float>(samples_.size())};
    kernels_.sample(tile.rays, sample, sampling_, sum);
  }
}

void Renderer::develop_row(int tile_row, const Exposure& exposure, GrayImage* image) const {
  DevelopParameters develop;
  develop.gain = static_cast<float>(exposure.gain);
  develop.vignetting = static_cast<float>(scenario_.vignetting);
  develop.noise_sigma = static_cast<float>(exposure.noise_sigma);
  develop.noise_key = static_cast<uint32_t>(mix_bits(exposure.noise_key));
  develop.pixels_per_row = static_cast<uint32_t>(columns_ * kTileWidth);
  std::array<uint8_t, kTilePixels> pixels;
  const int y0 = tile_row * kTileHeight;
  const auto columns = static_cast<size_t>(columns_);
  for (size_t column = 0; column < columns; ++column) {
    const int x0 = static_cast<int>(column) * kTileWidth;
    develop.first_pixel = static_cast<uint32_t>(y0) * develop.pixels_per_row + static_cast<uint32_t>(x0);
    const Tile& tile = tiles_[static_cast<size_t>(tile_row) * columns + column];
    kernels_.develop(tile.rays, sums_[column], develop, &pixels);
    const int width = std::min(kTileWidth, image->width() - x0);
    for (int row = 0; row < std::min(kTileHeight, image->height() - y0); ++row) {
      std::copy_n(pixels.data() + static_cast<std::ptrdiff_t>(row) * kTileWidth, width,
                  image->row(y0 + row) + x0);
    }
  }
}

void Renderer::render(const CameraPath& camera_from_map, const Exposure& exposure, GrayImage* image) {
  image->resize(scenario_.camera->width(), scenario_.camera->height());
  plan_samples(camera_from_map, exposure.shutter);
  const bool rolling = exposure.readout > 0;
  for (int tile_row = 0; tile_row < rows_; ++tile_row) {
    // With a rolling shutter each row of tiles has its own time; without, all see the same views.
    const double row_seconds =
        rolling ? exposure.readout * ((tile_row + 0.5) * kTileHeight / image->height() - 0.5) : 0;
    if (rolling || tile_row == 0) project_views(camera_from_map, row_seconds);
    fill_bins(tile_row);
    for (size_t column = 0; column < sums_.size(); ++column) {
      sample_tile(tiles_[static_cast<size_t>(tile_row) * sums_.size() + column], column, &sums_[column]);
    }
    develop_row(tile_row, exposure, image);
  }
}

}  // namespace cairn
