// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/place_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <tuple>

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

bool same_measurements(const IndexedKeyframe& indexed, const KeyframeView& view) {
  return std::equal(indexed.measured.begin(), indexed.measured.end(), view.measurements.begin(),
                    view.measurements.end(),
                    [](PointId id, const PointMeasurement& m) { return id == m.id; });
}

struct Described {
  DescribedPoint point;
  Descriptor descriptor;
  CellId cell = 0;
};

/// All points at their scales, in no particular order.
std::vector<Described> describe_points(const KeyframeView& view) {
  std::vector<Described> described;
  described.reserve(2 * view.measurements.size());
  GrayImage smoothed;
  GrayImage reduced;
  for (int scale = 0; scale < kPlaceScales; ++scale) {
    const int level = scale / 2;
    const bool is_half = scale % 2 != 0;
    if (is_half) reduce(view.pyramid->level(level), &reduced);
    smooth_for_descriptors(is_half ? reduced : view.pyramid->level(level), &smoothed);
    for (uint32_t i = 0; i < view.measurements.size(); ++i) {
      const PointMeasurement& m = view.measurements[i];
      Described d;
      if (m.level != level || !describe(smoothed, nearest_pixel(m.pixel, level, is_half), &d.descriptor))
        continue;
      d.point = {m.id, i, m.level, static_cast<uint8_t>(scale), m.pixel};
      d.cell = cell_of(d.descriptor);
      described.push_back(d);
    }
  }
  return described;
}

void sort_into_cells(std::vector<Described> described, IndexedKeyframe* keyframe) {
  std::sort(described.begin(), described.end(), [](const Described& a, const Described& b) {
    return std::tuple(a.cell, a.point.scale, a.point.id) < std::tuple(b.cell, b.point.scale, b.point.id);
  });
  keyframe->points.reserve(described.size());
  keyframe->descriptors.reserve(described.size());
  for (const Described& d : described) {
    keyframe->points.push_back(d.point);
    keyframe->descriptors.push_back(d.descriptor);
    keyframe->words.push_back(word_in(d.cell, d.descriptor));
    ++keyframe->begin_of[size_t{d.cell} * kPlaceScales + d.point.scale + 1];
  }
  std::partial_sum(keyframe->begin_of.begin(), keyframe->begin_of.end(), keyframe->begin_of.begin());
  std::sort(keyframe->words.begin(), keyframe->words.end());
  keyframe->words.erase(std::unique(keyframe->words.begin(), keyframe->words.end()), keyframe->words.end());
}

/// With the points sorted into cells.
std::vector<Sighting> make_sightings(const KeyframeView& view, const IndexedKeyframe& keyframe) {
  const GrayView small = view.pyramid->level(kPyramidLevels - 1);
  std::vector<Sighting> sightings;
  sightings.reserve(view.measurements.size());
  for (const PointMeasurement& m : view.measurements)
    sightings.push_back({m.pixel, brightness_at(small, m.pixel), m.level, 0, {}});
  for (uint32_t i = 0; i < keyframe.points.size(); ++i) {
    Sighting& sighting = sightings[keyframe.points[i].measured];
    sighting.described[sighting.descriptions++] = i;
  }
  return sightings;
}

std::vector<Eigen::Vector3f> find_positions(const MapSnapshot& snapshot, std::span<const PointId> points) {
  std::vector<Eigen::Vector3f> positions;
  positions.reserve(points.size());
  for (const PointId id : points) {
    const auto slot = snapshot.find(id);
    positions.push_back(slot ? snapshot.point_blocks[static_cast<size_t>(slot->block)]
                                   ->position(slot->slot)
                                   .cast<float>()
                                   .eval()
                             : Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()).eval());
  }
  return positions;
}

/// Index into the keyframes of the map.
std::optional<uint32_t> find_keyframe(const IndexedMap& map, KeyframeId id) {
  const auto at = std::lower_bound(map.keyframes.begin(), map.keyframes.end(), id,
                                   [](const IndexedKeyframePtr& k, KeyframeId key) { return k->id < key; });
  if (at == map.keyframes.end() || (*at)->id != id) return std::nullopt;
  return static_cast<uint32_t>(at - map.keyframes.begin());
}

const MapId& map_of(const KeyframePlace& place) {
  return place.map->snapshot->map;
}

auto position_of(const std::vector<IndexedMapPtr>& maps, const MapId& id) {
  return std::lower_bound(maps.begin(), maps.end(), id,
                          [](const IndexedMapPtr& m, const MapId& key) { return m->snapshot->map < key; });
}

}  // namespace

bool are_comparable(std::span<const CompactPicture> pictures) {
  return std::ranges::all_of(pictures,
                             [&](const CompactPicture& p) { return is_comparable(p, pictures.front()); });
}

InvertedLists invert(std::span<const IndexedKeyframePtr> keyframes) {
  InvertedLists lists;
  lists.begin.resize(kVocabularyWords + 1);
  for (const auto& k : keyframes) {
    for (const WordId word : k->words) ++lists.begin[word + size_t{1}];
  }
  std::partial_sum(lists.begin.begin(), lists.begin.end(), lists.begin.begin());
  lists.keyframes.resize(lists.begin.back());
  std::vector<uint32_t> next = lists.begin;
  for (uint32_t i = 0; i < keyframes.size(); ++i) {
    for (const WordId word : keyframes[i]->words) lists.keyframes[next[word]++] = i;
  }
  return lists;
}

IndexedKeyframePtr index_keyframe(const KeyframeView& view) {
  auto indexed = std::make_shared<IndexedKeyframe>();
  indexed->id = view.id;
  indexed->camera = view.camera;
  indexed->tiny.assign(view.pyramid->level(kPyramidLevels - 1), kPlaceBlur);
  indexed->contrast = contrast_of(indexed->tiny);
  indexed->measured.reserve(view.measurements.size());
  for (const PointMeasurement& m : view.measurements) indexed->measured.push_back(m.id);
  sort_into_cells(describe_points(view), indexed.get());
  indexed->sightings = make_sightings(view, *indexed);
  return indexed;
}

IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                        std::span<const KeyframeView> views) {
  auto map = std::make_shared<IndexedMap>();
  for (const KeyframeView& view : views) {
    if (snapshot->find(view.id) == nullptr) continue;
    const auto known = previous != nullptr ? find_keyframe(*previous, view.id) : std::nullopt;
    const bool has_picture = view.pyramid != nullptr;
    if (!known && !has_picture) continue;
    const bool is_same = known && (!has_picture || same_measurements(*previous->keyframes[*known], view));
    map->keyframes.push_back(is_same ? previous->keyframes[*known] : index_keyframe(view));
  }
  std::sort(map->keyframes.begin(), map->keyframes.end(),
            [](const IndexedKeyframePtr& a, const IndexedKeyframePtr& b) { return a->id < b->id; });
  map->pictures.reserve(map->keyframes.size());
  for (const IndexedKeyframePtr& k : map->keyframes) {
    const auto known = previous != nullptr ? find_keyframe(*previous, k->id) : std::nullopt;
    map->pictures.push_back(known && previous->keyframes[*known] == k ? previous->pictures[*known]
                                                                      : make_compact(k->tiny));
  }
  map->is_of_one_size = are_comparable(map->pictures);
  map->lists = invert(map->keyframes);
  map->positions.reserve(map->keyframes.size());
  for (const IndexedKeyframePtr& k : map->keyframes)
    map->positions.push_back(find_positions(*snapshot, k->measured));
  map->snapshot = std::move(snapshot);
  return map;
}

void PlaceIndex::put(IndexedMapPtr map) {
  locate(map->snapshot->map, map.get());
  count(*map, 1);
  const auto at = position_of(maps_, map->snapshot->map);
  if (at != maps_.end() && (*at)->snapshot->map == map->snapshot->map) {
    IndexedMapPtr& there = maps_[static_cast<size_t>(at - maps_.begin())];
    count(*there, -1);
    there = std::move(map);
  } else {
    maps_.insert(at, std::move(map));
  }
}

void PlaceIndex::remove(const MapId& map) {
  const auto at = position_of(maps_, map);
  if (at == maps_.end() || (*at)->snapshot->map != map) return;
  locate(map, nullptr);
  count(**at, -1);
  maps_.erase(at);
}

void PlaceIndex::count(const IndexedMap& map, int sign) {
  keyframe_count_ += static_cast<size_t>(sign) * map.keyframes.size();
  shown_in_all_ += static_cast<uint64_t>(sign) * map.lists.begin.back();
  for (size_t word = 0; word < kVocabularyWords; ++word)
    shown_[word] += static_cast<uint32_t>(sign) * (map.lists.begin[word + 1] - map.lists.begin[word]);
}

void PlaceIndex::locate(const MapId& id, const IndexedMap* map) {
  std::vector<bool> has_slot(map != nullptr ? map->keyframes.size() : 0);
  if (forest_) {
    const auto& slots = forest_->slots();
    const auto begin = std::lower_bound(slots.begin(), slots.end(), id,
                                        [](const auto& slot, const MapId& key) { return slot.map < key; });
    for (auto slot = begin; slot != slots.end() && slot->map == id; ++slot) {
      KeyframePlace& place = planted_[static_cast<size_t>(slot - slots.begin())];
      auto keyframe = map != nullptr ? find_keyframe(*map, slot->keyframe) : std::nullopt;
      // A map that was purged and comes back from an archive may have other pictures by the same names.
      if (keyframe && map->pictures[*keyframe] != forest_->picture(static_cast<size_t>(slot - slots.begin())))
        keyframe.reset();
      gone_ += static_cast<size_t>(!keyframe) - static_cast<size_t>(place.map == nullptr);
      place = keyframe ? KeyframePlace{map, *keyframe} : KeyframePlace{};
      if (keyframe) has_slot[*keyframe] = true;
    }
  }
  const auto first =
      std::lower_bound(unplanted_.begin(), unplanted_.end(), id,
                       [](const KeyframePlace& p, const MapId& key) { return map_of(p) < key; });
  const auto last = std::find_if(first, unplanted_.end(), [&](const auto& p) { return map_of(p) != id; });
  const auto at = unplanted_.erase(first, last);
  std::vector<KeyframePlace> fresh;
  for (uint32_t k = 0; k < has_slot.size(); ++k) {
    if (!has_slot[k]) fresh.push_back({map, k});
  }
  unplanted_.insert(at, fresh.begin(), fresh.end());
}

bool PlaceIndex::needs_planting(size_t most_scanned) const {
  return unplanted_.size() > most_scanned || 2 * gone_ > planted_.size();
}

void PlaceIndex::set_forest(PictureForestPtr forest) {
  forest_ = std::move(forest);
  planted_.assign(forest_ ? forest_->slots().size() : 0, {});
  gone_ = planted_.size();
  unplanted_.clear();
  for (const IndexedMapPtr& map : maps_) locate(map->snapshot->map, map.get());
}

const IndexedMap* PlaceIndex::find(const MapId& map) const {
  const auto at = position_of(maps_, map);
  return at != maps_.end() && (*at)->snapshot->map == map ? at->get() : nullptr;
}

PlaceIndex PlaceIndex::only(std::span<const MapId> maps) const {
  PlaceIndex those;
  for (const IndexedMapPtr& m : maps_) {
    if (std::find(maps.begin(), maps.end(), m->snapshot->map) != maps.end()) those.put(m);
  }
  return those;
}

PictureForestPtr plant_forest(const PlaceIndex& index, size_t most_scanned) {
  if (index.keyframe_count() <= most_scanned) return nullptr;
  std::vector<PictureForest::Picture> pictures;
  pictures.reserve(index.keyframe_count());
  for (const IndexedMapPtr& map : index.maps()) {
    for (size_t k = 0; k < map->keyframes.size(); ++k)
      pictures.push_back({map->snapshot->map, map->keyframes[k]->id, map->pictures[k]});
  }
  return std::make_shared<const PictureForest>(pictures);
}

}  // namespace cairn
