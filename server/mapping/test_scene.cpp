// SPDX-License-Identifier: Apache-2.0
#include "server/mapping/test_scene.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace cairn::testing {
namespace {

constexpr int kTexels = 1024;
constexpr double kTexelsPerMetre = 500;
constexpr double kBoardLeft = 0.02;
constexpr double kBoardRight = 0.35;
constexpr double kSubpixels[2] = {-0.25, 0.25};
constexpr int kSamples = 4;  ///< of a pixel

/// The front plane: a board.
bool on_board(const Eigen::Vector3d& p) {
  return p.x() > kBoardLeft && p.x() < kBoardRight && p.y() > -0.25 && p.y() < 0.15;
}

/// Texture coordinate [texel] of a place along an axis [m].
double texel(double metres) {
  return metres * kTexelsPerMetre + 400;
}

/// Random rectangles of random grey, large ones first: corners at every scale.
std::vector<float> make_texture(std::mt19937_64* engine) {
  std::vector<float> t(static_cast<size_t>(kTexels) * kTexels, 128.0F);
  const auto random = [engine](int low, int high) {
    return std::uniform_int_distribution<int>(low, high)(*engine);
  };
  for (int i = 0; i < 3500; ++i) {
    const int size = i < 300 ? 100 : i < 1200 ? 40 : 14;
    const int x0 = random(0, kTexels - 1);
    const int y0 = random(0, kTexels - 1);
    const int x1 = std::min(kTexels, x0 + random(4, size));
    const int y1 = std::min(kTexels, y0 + random(4, size));
    const auto grey = static_cast<float>(random(30, 220));
    for (int y = y0; y < y1; ++y) std::fill_n(t.begin() + y * kTexels + x0, x1 - x0, grey);
  }
  return t;
}

float bilinear(const std::vector<float>& t, double x, double y) {
  const auto wrap = [](int v) { return static_cast<size_t>(v & (kTexels - 1)); };
  const double fx = std::floor(x);
  const double fy = std::floor(y);
  const auto ax = static_cast<float>(x - fx);
  const auto ay = static_cast<float>(y - fy);
  const size_t x0 = wrap(static_cast<int>(fx));
  const size_t x1 = wrap(static_cast<int>(fx) + 1);
  const size_t y0 = wrap(static_cast<int>(fy)) * kTexels;
  const size_t y1 = wrap(static_cast<int>(fy) + 1) * kTexels;
  return (t[y0 + x0] * (1 - ax) + t[y0 + x1] * ax) * (1 - ay) +
         (t[y1 + x0] * (1 - ax) + t[y1 + x1] * ax) * ay;
}

}  // namespace

Scene::Scene(uint64_t seed) {
  CameraParameters p;
  p.width = 400;
  p.height = 300;
  p.values = {330, 330, 199.5, 149.5, -0.08, 0.02, 0, 0};
  camera_ = *make_camera(p);
  std::mt19937_64 engine(seed);
  for (auto& t : textures_) t = make_texture(&engine);
}

Scene::Scene(uint64_t seed, uint64_t board_seed, double share) : Scene(seed) {
  std::mt19937_64 engine(board_seed);
  std::vector<float>& board = textures_[1];
  board = make_texture(&engine);
  const auto first_plain = static_cast<int>(texel(kBoardLeft + share * (kBoardRight - kBoardLeft)));
  for (int y = 0; y < kTexels; ++y)
    std::fill(board.begin() + y * kTexels + first_plain, board.begin() + (y + 1) * kTexels, 128.0F);
}

Scene::Scene(uint64_t seed, CameraPtr camera) : Scene(seed) {
  camera_ = std::move(camera);
}

SE3 Scene::pose(int step) {
  Vector6d xi;
  xi << -0.045 * step, 0.01 * std::sin(1.3 * step), 0.015 * std::sin(0.9 * step), 0.01 * std::sin(2.1 * step),
      -0.012 * step, 0.02 * std::sin(0.7 * step);
  return SE3::exp(xi);
}

Scene::Hit Scene::trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  const Eigen::Vector3d front = origin + direction * ((kFrontDepth - origin.z()) / direction.z());
  if (on_board(front)) return {front, 1};
  return {origin + direction * ((kBackDepth - origin.z()) / direction.z()), 0};
}

float Scene::texture(const Hit& hit) const {
  return bilinear(textures_[static_cast<size_t>(hit.plane)], texel(hit.point.x()), texel(hit.point.y()));
}

const std::vector<Eigen::Vector3d>& Scene::rays() const {
  std::call_once(views_->rays_made, [this] {
    for (int y = 0; y < camera_->height(); ++y) {
      for (int x = 0; x < camera_->width(); ++x) {
        for (const double dy : kSubpixels)
          for (const double dx : kSubpixels) views_->rays.push_back(camera_->unproject({x + dx, y + dy}));
      }
    }
  });
  return views_->rays;
}

GrayImagePtr Scene::render(const SE3& camera_from_world, uint64_t frame) const {
  std::mt19937_64 engine(frame + 1000);
  std::normal_distribution<float> noise(0, 1.5F);
  auto image = std::make_shared<GrayImage>(camera_->width(), camera_->height());
  const SE3 world_from_camera = camera_from_world.inverse();
  auto ray = rays().begin();
  for (int y = 0; y < image->height(); ++y) {
    for (int x = 0; x < image->width(); ++x) {
      float sum = 0;
      for (int sample = 0; sample < kSamples; ++sample)
        sum += texture(trace(world_from_camera.translation(), world_from_camera.rotation() * *ray++));
      image->row(y)[x] = static_cast<uint8_t>(std::clamp(0.25F * sum + noise(engine), 0.0F, 255.0F));
    }
  }
  return image;
}

GrayImagePtr Scene::view(int step) const {
  const std::lock_guard lock(views_->mutex);
  GrayImagePtr& image = views_->of_step[step];
  if (!image) image = render(pose(step), static_cast<uint64_t>(step));
  return image;
}

Eigen::Vector3d Scene::hit(const SE3& camera_from_world, const Eigen::Vector2d& pixel) const {
  const SE3 world_from_camera = camera_from_world.inverse();
  return trace(world_from_camera.translation(), world_from_camera.rotation() * camera_->unproject(pixel))
      .point;
}

bool Scene::sees(const SE3& camera_from_world, const Eigen::Vector3d& point) const {
  const auto pixel = camera_->project(camera_from_world * point);
  return pixel && camera_->in_image(*pixel) && (hit(camera_from_world, *pixel) - point).norm() < 1e-3;
}

Similarity3 world_from_map(const MapSnapshot& s) {
  const SE3& first = s.find(KeyframeId{1})->camera_from_map;
  const SE3& second = s.find(KeyframeId{2})->camera_from_map;
  const double scale = (Scene::pose(0).center() - Scene::pose(kSecondStep).center()).norm() /
                       (first.center() - second.center()).norm();
  const Eigen::Quaterniond rotation = Scene::pose(0).rotation().conjugate() * first.rotation();
  return {scale, rotation, Scene::pose(0).center() - scale * (rotation * first.center())};
}

}  // namespace cairn::testing
