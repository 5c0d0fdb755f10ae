// SPDX-License-Identifier: Apache-2.0
#include "tests/world/render.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "tests/world/random.h"

namespace cairn {
namespace {

constexpr int kMinEdgeSamples = 4;   // what edges need to look smooth
constexpr int kMinPlainSamples = 2;  // where there is only filtered texture
constexpr int kMaxSamples = 24;            // beyond 24 px of blur nothing is left to alias
constexpr double kBlurPerSample = 1.5;     // px
constexpr float kTextureLevelBias = -0.5F;  // two samples or more per pixel

/// Fractional part of a low-discrepancy sequence's element, by the multiples of an irrational number.
double fraction_of_multiple(size_t i, double irrational) {
  const double multiple = static_cast<double>(i) * irrational;
  return multiple - std::floor(multiple);
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
    view_ = view_.united(tile.box);
    IdealBox& row_box = row_boxes_[index / static_cast<size_t>(columns_)];
    row_box = index % static_cast<size_t>(columns_) == 0 ? tile.box : row_box.united(tile.box);
  }
}

/// How far [px] the scene moves in the image between two poses: nine tenths of the landmarks in view move less.
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

void Renderer::spread_samples(int count, double shutter, Plan* plan) {
  plan->samples.resize(static_cast<size_t>(count));
  plan->views.resize(plan->samples.size());
  double mean_x = 0;
  double mean_y = 0;
  for (size_t i = 0; i < plan->samples.size(); ++i) {
    // The R2 sequence (Roberts): even over the pixel for every count, and not in step with time.
    plan->samples[i] = {((static_cast<double>(i) + 0.5) / count - 0.5) * shutter,
                        fraction_of_multiple(i, 0.7548776662466927), fraction_of_multiple(i, 0.5698402909980532)};
    mean_x += plan->samples[i].pixel_x / count;
    mean_y += plan->samples[i].pixel_y / count;
  }
  for (Sample& sample : plan->samples) {  // the mean place is the pixel's centre exactly: no bias of the image
    sample.pixel_x -= mean_x;
    sample.pixel_y -= mean_y;
  }
}

void Renderer::project_faces(const SE3& camera_from_map, View* view) const {
  view->faces.clear();
  view->near_to_far.clear();
  for (const Face& face : scenario_.faces) {
    auto projected =
        project_face(face, scenario_.textures[static_cast<size_t>(face.texture)], camera_from_map, view_);
    if (projected) view->faces.push_back(*projected);
  }
  for (const ProjectedFace& face : view->faces) view->near_to_far.push_back(&face);
  std::ranges::stable_sort(view->near_to_far, std::greater{}, &ProjectedFace::nearest);
}

void Renderer::project_faces(const CameraPath& camera_from_map, double row_seconds, Plan* plan) const {
  for (size_t i = 0; i < plan->samples.size(); ++i) {
    project_faces(camera_from_map(row_seconds + plan->samples[i].seconds), &plan->views[i]);
  }
}

/// Adds a face to what may show in a tile, unless it is outside or hidden; takes out what it hides.
void Renderer::bin_face(const ProjectedFace& face, const IdealBox& box, TileBin* bin) {
  const auto hides = [&box](const ProjectedFace& front, const ProjectedFace& back) {
    return box.maximum(back.inverse_depth - front.inverse_depth) < 0;
  };
  if (!face.bounds.overlaps(box) || (bin->occluder != nullptr && hides(*bin->occluder, face))) return;
  uint32_t crossing = 0;
  for (int edge = 0; edge < face.edge_count; ++edge) {
    const LinearFunction& f = face.edges[static_cast<size_t>(edge)];
    if (box.maximum(f) < 0) return;
    if (box.minimum(f) < 0) crossing |= 1U << edge;
  }
  if (crossing == 0) {
    std::erase_if(bin->faces, [&](const TileFace& other) { return hides(face, *other.face); });
    bin->occluder = &face;
  }
  bin->faces.push_back({&face, crossing});
}

/// Sorts the faces of a plan's views into the tiles of one row.
void Renderer::fill_bins(int tile_row, Plan* plan) const {
  const auto columns = static_cast<size_t>(columns_);
  const std::span tiles(&tiles_[static_cast<size_t>(tile_row) * columns], columns);
  const IdealBox& row_box = row_boxes_[static_cast<size_t>(tile_row)];
  plan->bins.resize(plan->samples.size() * columns);
  for (TileBin& bin : plan->bins) {
    bin.faces.clear();
    bin.occluder = nullptr;
  }
  for (size_t i = 0; i < plan->views.size(); ++i) {
    for (const ProjectedFace* face : plan->views[i].near_to_far) {
      if (!face->bounds.overlaps(row_box)) continue;
      for (size_t column = 0; column < columns; ++column) {
        if (tiles[column].box.x1 < face->bounds.x0) continue;
        if (tiles[column].box.x0 > face->bounds.x1) break;
        bin_face(*face, tiles[column].box, &plan->bins[i * columns + column]);
      }
    }
  }
}

/// The mean of a plan's samples for one tile.
void Renderer::sample_tile(const Plan& plan, size_t column, const Tile& tile, TileSum* sum) const {
  sum->fill(0);
  const auto columns = static_cast<size_t>(columns_);
  const float weight = 1.0F / static_cast<float>(plan.samples.size());
  for (size_t i = 0; i < plan.samples.size(); ++i) {
    const auto x = static_cast<float>(plan.samples[i].pixel_x);
    const auto y = static_cast<float>(plan.samples[i].pixel_y);
    const RayShift shift = {x * tile.per_pixel_x.x + y * tile.per_pixel_y.x,
                            x * tile.per_pixel_x.y + y * tile.per_pixel_y.y};
    kernels_.sample(tile.rays, shift, plan.bins[i * columns + column].faces, sampling_, weight, sum);
  }
}

void Renderer::sample_row(int tile_row, const Plan& fine, const Plan& coarse) {
  const auto columns = static_cast<size_t>(columns_);
  for (size_t column = 0; column < columns; ++column) {
    bool plain = true;
    for (size_t i = 0; i < coarse.samples.size(); ++i) plain &= coarse.bins[i * columns + column].plain();
    sample_tile(plain ? coarse : fine, column, tiles_[static_cast<size_t>(tile_row) * columns + column],
                &sums_[column]);
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
  for (int column = 0; column < columns_; ++column) {
    const int x0 = column * kTileWidth;
    develop.first_pixel = static_cast<uint32_t>(y0) * develop.pixels_per_row + static_cast<uint32_t>(x0);
    const Tile& tile = tiles_[static_cast<size_t>(tile_row * columns_ + column)];
    kernels_.develop(tile.rays, sums_[static_cast<size_t>(column)], develop, &pixels);
    const int width = std::min(kTileWidth, image->width() - x0);
    for (int row = 0; row < std::min(kTileHeight, image->height() - y0); ++row) {
      std::copy_n(&pixels[static_cast<size_t>(row * kTileWidth)], width, image->row(y0 + row) + x0);
    }
  }
}

void Renderer::render(const CameraPath& camera_from_map, const Exposure& exposure, GrayImage* image) {
  image->resize(scenario_.camera->width(), scenario_.camera->height());
  const double blur = exposure.shutter <= 0 ? 0
                                            : image_motion(camera_from_map(-0.5 * exposure.shutter),
                                                           camera_from_map(0.5 * exposure.shutter));
  const int blur_samples = std::min(static_cast<int>(std::ceil(blur / kBlurPerSample)), kMaxSamples);
  const std::array<Plan*, 2> plans = {&fine_, &coarse_};
  spread_samples(std::max(blur_samples, kMinEdgeSamples), exposure.shutter, &fine_);
  spread_samples(std::max(blur_samples, kMinPlainSamples), exposure.shutter, &coarse_);
  const bool rolling = exposure.readout > 0;
  for (int tile_row = 0; tile_row < rows_; ++tile_row) {
    // With a rolling shutter each row of tiles has its own time; without, all see the same views.
    const double row_seconds =
        rolling ? exposure.readout * ((tile_row + 0.5) * kTileHeight / image->height() - 0.5) : 0;
    for (Plan* plan : plans) {
      if (rolling || tile_row == 0) project_faces(camera_from_map, row_seconds, plan);
      fill_bins(tile_row, plan);
    }
    sample_row(tile_row, fine_, coarse_);
    develop_row(tile_row, exposure, image);
  }
}

}  // namespace cairn
