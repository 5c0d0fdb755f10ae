// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <random>
#include <vector>

#include "common/map/limits.h"
#include "common/map/snapshot.h"

namespace cairn::testing {

/// A map under continuous adjustment: each revision moves some blocks and the keyframes; now and then it
/// grows.
class AdjustedMap {
 public:
  AdjustedMap(MapId map, unsigned seed, uint32_t blocks) : map_(map), random_(seed) {
    for (uint32_t index = 0; index < blocks; ++index) grow();
  }

  MapSnapshotPtr next() {
    ++revision_;
    if (revision_ % 20 == 0) grow();
    auto keyframes = std::make_shared<KeyframeBlock>();
    keyframes->version = revision_;
    keyframes->live = 1;
    keyframes->keyframes = {{{1}, SE3(Eigen::Quaterniond::Identity(), {offset(), offset(), offset()}), 2}};
    auto snapshot = std::make_shared<MapSnapshot>();
    snapshot->map = map_;
    snapshot->name = "adjusted";
    snapshot->epoch = {1};
    snapshot->revision = {revision_};
    snapshot->keyframe_blocks = {keyframes};
    for (size_t b = 0; b < patches_.size(); ++b) {
      if (random_() % 3 != 0) move(b);
      snapshot->point_blocks.push_back(
          make_point_block(patches_[b], positions_[b], snapshot->keyframe_blocks));
    }
    return snapshot;
  }

 private:
  double offset() { return std::uniform_real_distribution<double>(-0.1, 0.1)(random_); }

  void grow() {
    auto block = std::make_shared<PatchBlock>();
    block->index = static_cast<uint32_t>(patches_.size());
    block->version = revision_ + 1;
    block->points.resize(kBlockSlots);
    for (size_t slot = 0; slot < kBlockSlots; ++slot) {
      PointSource& point = block->points[slot];
      point.id = {1 + patches_.size() * kBlockSlots + slot};
      point.keyframe = {1};
      point.corner = {20, 20};
      point.ray_right = Eigen::Vector3f(0.002F, 0, 1).normalized();
      point.ray_down = Eigen::Vector3f(0, 0.002F, 1).normalized();
      for (uint8_t& pixel : point.pixels) pixel = static_cast<uint8_t>(random_());
    }
    patches_.push_back(block);
    positions_.emplace_back();
    move(patches_.size() - 1);
  }

  void move(size_t b) {
    auto block = std::make_shared<PositionBlock>();
    block->index = static_cast<uint32_t>(b);
    block->version = revision_ + 1;
    block->live = ~uint64_t{0};
    block->visibility.resize(kBlockSlots);
    for (int slot = 0; slot < kBlockSlots; ++slot) {
      block->positions.push_back(
          (Eigen::Vector3d(0, 0, 2) + Eigen::Vector3d(offset(), offset(), offset())).cast<float>());
    }
    positions_[b] = block;
  }

  const MapId map_;
  std::mt19937 random_;
  uint64_t revision_ = 0;
  std::vector<std::shared_ptr<const PatchBlock>> patches_;
  std::vector<std::shared_ptr<const PositionBlock>> positions_;
};

}  // namespace cairn::testing
