// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/place_index.h"

#include <algorithm>
#include <cmath>

#include "common/image/patch.h"

namespace cairn {
namespace {

constexpr float kHalfOctave = 1.41421356F;

Corner nearest_pixel(const Eigen::Vector2f& level0, int level, bool is_half) {
  const auto place = [&](float v) {
    const float at_level = to_level(v, level);
    return static_cast<int16_t>(std::lround(is_half ? (at_level + 0.5F) / kHalfOctave - 0.5F : at_level));
  };
  return {place(level0.x()), place(level0.y())};
}

/// The image reduced by the square root of two, bilinearly.
void reduce(const GrayView& image, GrayImage* out) {
  out->resize(static_cast<int>(static_cast<float>(image.width) / kHalfOctave),
              static_cast<int>(static_cast<float>(image.height) / kHalfOctave));
  const auto source = [](int i, int size) {
    return std::clamp((static_cast<float>(i) + 0.5F) * kHalfOctave - 0.5F, 0.0F,
                      static_cast<float>(size) - 1.001F);
  };
  for (int y = 0; y < out->height(); ++y) {
    for (int x = 0; x < out->width(); ++x) {
      const float value = sample_bilinear(image, source(x, image.width), source(y, image.height));
      out->row(y)[x] = static_cast<uint8_t>(std::lround(value));
    }
  }
}

float root_mean_square(const TinyImage& image) {
  double sum = 0;
  for (const float v : image.values()) sum += static_cast<double>(v) * v;
  return image.empty() ? 0 : static_cast<float>(std::sqrt(sum / static_cast<double>(image.values().size())));
}

bool same_measurements(const IndexedKeyframe& indexed, const KeyframeView& view) {
  return std::equal(indexed.measured.begin(), indexed.measured.end(), view.measurements.begin(),
                    view.measurements.end(),
                    [](PointId id, const PointMeasurement& m) { return id == m.id; });
}

auto position_of(const std::vector<IndexedMapPtr>& maps, const MapId& id) {
  return std::lower_bound(maps.begin(), maps.end(), id,
                          [](const IndexedMapPtr& m, const MapId& key) { return m->snapshot->map < key; });
}

}  // namespace

IndexedKeyframePtr index_keyframe(const KeyframeView& view) {
  auto indexed = std::make_shared<IndexedKeyframe>();
  indexed->id = view.id;
  indexed->camera = view.camera;
  indexed->tiny.assign(view.pyramid->level(kPyramidLevels - 1), kPlaceBlur);
  indexed->contrast = root_mean_square(indexed->tiny);
  indexed->measured.reserve(view.measurements.size());
  for (const PointMeasurement& m : view.measurements) indexed->measured.push_back(m.id);
  GrayImage smoothed;
  GrayImage reduced;
  for (int scale = 0; scale < kPlaceScales; ++scale) {
    const int level = scale / 2;
    const bool is_half = scale % 2 != 0;
    if (is_half) reduce(view.pyramid->level(level), &reduced);
    smooth_for_descriptors(is_half ? reduced : view.pyramid->level(level), &smoothed);
    for (const PointMeasurement& m : view.measurements) {
      Descriptor descriptor;
      if (m.level != level || !describe(smoothed, nearest_pixel(m.pixel, level, is_half), &descriptor))
        continue;
      indexed->points.push_back({m.id, m.level, m.pixel});
      indexed->descriptors.push_back(descriptor);
    }
    indexed->scale_begin[static_cast<size_t>(scale) + 1] = indexed->points.size();
  }
  return indexed;
}

IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                        std::span<const KeyframeView> views) {
  auto map = std::make_shared<IndexedMap>();
  for (const KeyframeView& view : views) {
    if (snapshot->find(view.id) == nullptr) continue;
    IndexedKeyframePtr known;
    if (previous != nullptr) {
      const auto it = std::lower_bound(previous->keyframes.begin(), previous->keyframes.end(), view.id,
                                       [](const IndexedKeyframePtr& k, KeyframeId id) { return k->id < id; });
      if (it != previous->keyframes.end() && (*it)->id == view.id && same_measurements(**it, view))
        known = *it;
    }
    map->keyframes.push_back(known ? known : index_keyframe(view));
  }
  std::sort(map->keyframes.begin(), map->keyframes.end(),
            [](const IndexedKeyframePtr& a, const IndexedKeyframePtr& b) { return a->id < b->id; });
  map->snapshot = std::move(snapshot);
  return map;
}

void PlaceIndex::put(IndexedMapPtr map) {
  const auto at = position_of(maps_, map->snapshot->map);
  if (at != maps_.end() && (*at)->snapshot->map == map->snapshot->map) {
    maps_[static_cast<size_t>(at - maps_.begin())] = std::move(map);
  } else {
    maps_.insert(at, std::move(map));
  }
}

void PlaceIndex::remove(const MapId& map) {
  std::erase_if(maps_, [&](const IndexedMapPtr& m) { return m->snapshot->map == map; });
}

const IndexedMap* PlaceIndex::find(const MapId& map) const {
  const auto at = position_of(maps_, map);
  return at != maps_.end() && (*at)->snapshot->map == map ? at->get() : nullptr;
}

size_t PlaceIndex::keyframe_count() const {
  size_t count = 0;
  for (const IndexedMapPtr& m : maps_) count += m->keyframes.size();
  return count;
}

}  // namespace cairn
