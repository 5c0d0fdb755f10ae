// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/plane_scene.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "client/tracking/view_map.h"

namespace cairn::test {
namespace {

/// The point at which a ray of the camera meets the plane Z = 0, in the map frame.
Eigen::Vector3d on_plane(const SE3& map_from_camera, const Eigen::Vector3d& ray_in_camera) {
  const Eigen::Vector3d ray = map_from_camera.rotation() * ray_in_camera;
  const Eigen::Vector3d& center = map_from_camera.translation();
  return center - ray * (center.z() / ray.z());
}

}  // namespace

PlaneScene::PlaneScene(uint64_t seed, CameraPtr camera)
    : camera_(std::move(camera)), texture_(static_cast<size_t>(kTexels) * kTexels, 128.0F) {
  // Blobs of many sizes with sharp borders: corners on every pyramid level.
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (int blob = 0; blob < 6000; ++blob) {
    const double size = 4 * std::pow(12.0, uniform(random) * uniform(random));
    const auto x0 = static_cast<int>(uniform(random) * kTexels);
    const auto y0 = static_cast<int>(uniform(random) * kTexels);
    const auto w = static_cast<int>(size * (0.5 + uniform(random)));
    const auto h = static_cast<int>(size * (0.5 + uniform(random)));
    const auto grey = static_cast<float>(20 + 215 * uniform(random));
    for (int y = y0; y < std::min(kTexels, y0 + h); ++y) {
      for (int x = x0; x < std::min(kTexels, x0 + w); ++x)
        texture_[static_cast<size_t>(y * kTexels + x)] = grey;
    }
  }
  for (int y = 0; y < camera_->height(); ++y) {
    for (int x = 0; x < camera_->width(); ++x) {
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const int column = s % kSamples;
        const int row = s / kSamples;
        const double dx = (column + 0.5) / kSamples - 0.5;
        const double dy = (row + 0.5) / kSamples - 0.5;
        rays_.push_back(camera_->unproject({x + dx, y + dy}));
      }
    }
  }
}

double PlaneScene::brightness(double x, double y) const {
  const double u = std::clamp(x * kTexelsPerMetre + kTexels / 2.0, 0.0, kTexels - 2.0);
  const double v = std::clamp(y * kTexelsPerMetre + kTexels / 2.0, 0.0, kTexels - 2.0);
  const auto iu = static_cast<size_t>(u);
  const auto iv = static_cast<size_t>(v);
  const double fu = u - static_cast<double>(iu);
  const double fv = v - static_cast<double>(iv);
  const float* t = &texture_[iv * kTexels + iu];
  return (1 - fv) * ((1 - fu) * t[0] + fu * t[1]) + fv * ((1 - fu) * t[kTexels] + fu * t[kTexels + 1]);
}

GrayImagePtr PlaneScene::render(const SE3& camera_from_map) const {
  auto image = std::make_shared<GrayImage>(camera_->width(), camera_->height());
  const SE3 map_from_camera = camera_from_map.inverse();
  const Eigen::Vector3d* ray = rays_.data();
  for (int y = 0; y < camera_->height(); ++y) {
    for (int x = 0; x < camera_->width(); ++x) {
      double sum = 0;
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const Eigen::Vector3d point = on_plane(map_from_camera, *ray++);
        sum += brightness(point.x(), point.y());
      }
      image->row(y)[x] = static_cast<uint8_t>(std::lround(sum / (kSamples * kSamples)));
    }
  }
  return image;
}

MapSnapshotPtr PlaneScene::make_map(const SE3& camera_from_map) const {
  const SE3 map_from_camera = camera_from_map.inverse();
  const View view{camera_from_map, static_cast<float>(std::abs(map_from_camera.translation().z())),
                  Eigen::Vector3d::UnitZ()};
  return map_of_view(*camera_, render(camera_from_map)->view(), view,
                     [&](const Eigen::Vector3d& ray) { return on_plane(map_from_camera, ray); });
}

}  // namespace cairn::test
