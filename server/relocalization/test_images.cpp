// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/test_images.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace cairn::testing {
namespace {

constexpr int kWidth = 80;  // of level 3 of an image
constexpr int kHeight = 60;

/// Keyframes 1 to `count`, all in one place.
std::vector<std::shared_ptr<const KeyframeBlock>> keyframe_blocks(size_t count) {
  std::vector<std::shared_ptr<const KeyframeBlock>> blocks;
  for (size_t first = 0; first < count; first += kBlockSlots) {
    auto block = std::make_shared<KeyframeBlock>();
    block->index = static_cast<uint32_t>(blocks.size());
    for (size_t i = first; i < std::min(count, first + kBlockSlots); ++i) {
      block->live |= uint64_t{1} << (i - first);
      block->keyframes.push_back({KeyframeId{i + 1}, SE3(), 1});
    }
    blocks.push_back(std::move(block));
  }
  return blocks;
}

}  // namespace

LeafPlace::LeafPlace(uint64_t seed) : canvas_(kWidth + 2 * kMargin, kHeight + 2 * kMargin) {
  constexpr int kLeaves = 150;
  constexpr float kSmallest = 3;  // px
  constexpr float kLargest = 60;
  std::mt19937_64 random(seed);
  const auto below = [&](int n) { return static_cast<int>(random() % static_cast<uint64_t>(n)); };
  for (int leaf = 0; leaf < kLeaves; ++leaf) {
    // Radii fall with the third power: then no scale is preferred.
    const float u = static_cast<float>(below(1 << 20)) / (1 << 20);
    const float radius = kSmallest / std::sqrt(1 - u * (1 - kSmallest * kSmallest / (kLargest * kLargest)));
    const int reach = static_cast<int>(radius);
    const int cx = below(canvas_.width());
    const int cy = below(canvas_.height());
    const auto grey = static_cast<uint8_t>(below(256));
    for (int y = std::max(0, cy - reach); y <= std::min(canvas_.height() - 1, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x <= std::min(canvas_.width() - 1, cx + reach); ++x) {
        if (std::hypot(x - cx, y - cy) <= static_cast<double>(radius)) canvas_.row(y)[x] = grey;
      }
    }
  }
}

TinyImage LeafPlace::view(int dx, int dy, float gain) const {
  GrayImage level3(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x)
      level3.row(y)[x] = static_cast<uint8_t>(
          std::lround(gain * static_cast<float>(canvas_.row(y + kMargin + dy)[x + kMargin + dx])));
  }
  return {level3, kPlaceBlur};
}

MapId map_id(uint32_t number) {
  MapId id;
  for (size_t i = 0; i < sizeof number; ++i) id.bytes[i] = static_cast<uint8_t>(number >> (24 - 8 * i));
  return id;
}

IndexedMapPtr image_map(const MapId& id, std::vector<TinyImage> images,
                        std::vector<std::vector<WordId>> words) {
  words.resize(images.size());
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->map = id;
  snapshot->keyframe_blocks = keyframe_blocks(images.size());
  auto map = std::make_shared<IndexedMap>();
  for (size_t i = 0; i < images.size(); ++i) {
    auto keyframe = std::make_shared<IndexedKeyframe>();
    keyframe->id = KeyframeId{i + 1};
    keyframe->contrast = contrast_of(images[i]);
    keyframe->tiny = std::move(images[i]);
    keyframe->words = std::move(words[i]);
    map->images.push_back(make_compact(keyframe->tiny));
    map->keyframes.push_back(std::move(keyframe));
  }
  map->is_of_one_size = are_comparable(map->images);
  map->lists = invert(map->keyframes);
  map->positions.resize(map->keyframes.size());
  map->snapshot = std::move(snapshot);
  return map;
}

}  // namespace cairn::testing
