// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/round_room.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <utility>

#include "client/tracking/view_map.h"

namespace cairn::test {

RoundRoom::RoundRoom(uint64_t seed, CameraPtr camera, double radius)
    : seed_(seed), camera_(std::move(camera)), radius_(radius) {
  for (int y = 0; y < camera_->height(); ++y) {
    for (int x = 0; x < camera_->width(); ++x) {
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const double dx = (s % kSamples + 0.5) / kSamples - 0.5;
        const double dy =
            (s / kSamples + 0.5) / kSamples - 0.5;  // NOLINT(bugprone-integer-division): the row
        rays_.push_back(camera_->unproject({x + dx, y + dy}));
      }
    }
  }
}

double RoundRoom::distance(const SE3& camera_from_map, const Eigen::Vector3d& ray) const {
  const Eigen::Vector3d center = camera_from_map.center();
  const double along = center.dot(camera_from_map.rotation().conjugate() * ray);
  return -along + std::sqrt(along * along + radius_ * radius_ - center.squaredNorm());
}

/// Blocks of three sizes, cut by the wall: corners on every pyramid level.
double RoundRoom::brightness(const Eigen::Vector3d& on_wall) const {
  constexpr std::array<double, 3> kSizes = {0.23, 0.11, 0.05};  // of the radius
  double sum = 0;
  for (size_t i = 0; i < kSizes.size(); ++i) {
    const Eigen::Array3d cell = (on_wall.array() / (kSizes[i] * radius_)).floor();
    uint64_t hash = seed_ * 0x9E3779B97F4A7C15U + i;
    for (const double c : cell) {
      hash = (hash ^ static_cast<uint64_t>(static_cast<int64_t>(c))) * 0xBF58476D1CE4E5B9U;
      hash ^= hash >> 29;
    }
    sum += static_cast<double>(hash & 0xFFU) / 3;
  }
  return sum;
}

GrayImagePtr RoundRoom::render(const SE3& camera_from_map, double noise, uint64_t shot) const {
  std::mt19937_64 random(seed_ + 1000 * shot);
  std::normal_distribution<double> normal(0, noise);
  auto image = std::make_shared<GrayImage>(camera_->width(), camera_->height());
  const Eigen::Matrix3d map_from_camera = camera_from_map.rotation().conjugate().toRotationMatrix();
  const Eigen::Vector3d center = camera_from_map.center();
  const double inside = radius_ * radius_ - center.squaredNorm();
  const Eigen::Vector3d* ray = rays_.data();
  for (int y = 0; y < camera_->height(); ++y) {
    for (int x = 0; x < camera_->width(); ++x) {
      double sum = 0;
      for (int s = 0; s < kSamples * kSamples; ++s) {
        const Eigen::Vector3d direction = map_from_camera * *ray++;
        const double along = center.dot(direction);
        sum += brightness(center + (std::sqrt(along * along + inside) - along) * direction);
      }
      const double value = sum / (kSamples * kSamples) + normal(random);
      image->row(y)[x] = static_cast<uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
    }
  }
  return image;
}

GrayImagePtr RoundRoom::render_exposed(const std::function<SE3(double time)>& pose_at, double noise,
                                       uint64_t shot) const {
  constexpr int kParts = 6;
  std::vector<int> sums(static_cast<size_t>(camera_->width()) * static_cast<size_t>(camera_->height()),
                        kParts / 2);
  for (int k = 0; k < kParts; ++k) {
    const GrayImagePtr part = render(pose_at((k + 0.5) / kParts - 0.5), noise * std::sqrt(kParts),
                                     kParts * shot + static_cast<uint64_t>(k));
    size_t i = 0;
    for (int y = 0; y < part->height(); ++y) {
      for (int x = 0; x < part->width(); ++x) sums[i++] += part->row(y)[x];
    }
  }
  auto image = std::make_shared<GrayImage>(camera_->width(), camera_->height());
  size_t i = 0;
  for (int y = 0; y < image->height(); ++y) {
    for (int x = 0; x < image->width(); ++x) image->row(y)[x] = static_cast<uint8_t>(sums[i++] / kParts);
  }
  return image;
}

MapSnapshotPtr RoundRoom::map_of(const SE3& camera_from_map) const {
  const SE3 map_from_camera = camera_from_map.inverse();
  return map_of_view(
      *camera_, render(camera_from_map, 0, 0)->view(), {camera_from_map, static_cast<float>(radius_)},
      [&](const Eigen::Vector3d& ray) { return map_from_camera * (distance(camera_from_map, ray) * ray); });
}

MapSnapshotPtr RoundRoom::empty_map(const SE3& camera_from_map, uint64_t revision) const {
  auto keyframes = std::make_shared<KeyframeBlock>();
  keyframes->version = 1;
  keyframes->live = 1;
  keyframes->keyframes = {{KeyframeId{1}, camera_from_map, static_cast<float>(radius_)}};
  auto map = std::make_shared<MapSnapshot>();
  map->map.bytes[0] = 1;
  map->epoch = Epoch{1};
  map->revision = Revision{revision};
  map->keyframe_blocks = {keyframes};
  return map;
}

}  // namespace cairn::test
