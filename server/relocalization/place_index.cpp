// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/place_index.h"

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <optional>

namespace cairn {
namespace {

bool same_measurements(const IndexedKeyframe& indexed, const KeyframeView& view) {
  if (indexed.measured.size() != view.measurements.size()) return false;
  for (size_t i = 0; i < indexed.measured.size(); ++i) {
    const PointMeasurement& m = view.measurements[i];
    const Sighting& before = indexed.sightings[i];
    if (indexed.measured[i] != m.id || before.level != m.level || before.pixel != m.pixel) return false;
  }
  return true;
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

/// Index of a keyframe in those of the map; nothing if it is not there.
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

bool are_comparable(std::span<const CompactImage> images) {
  return std::ranges::all_of(images, [&](const CompactImage& p) { return is_comparable(p, images.front()); });
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

size_t bytes_indexed(size_t keyframes, size_t measurements) {
  constexpr size_t kExposures = 2;
  constexpr size_t kScales = 2;
  constexpr size_t kDescription = sizeof(DescribedPoint) + sizeof(Descriptor);
  constexpr size_t kMeasurement =
      sizeof(PointId) + sizeof(Sighting) + sizeof(Eigen::Vector3f) +
      kExposures * (sizeof(std::array<uint32_t, kScales>) + kScales * kDescription) +
      kScales * (sizeof(WordId) + sizeof(uint32_t));  // in `words`, and in the inverted lists
  constexpr size_t kTinyPixels = size_t{40} * 30;     // of 640x480
  return sizeof(IndexedMap) + kVocabularyWords * sizeof(uint32_t) +
         keyframes * (sizeof(IndexedKeyframe) + sizeof(CompactImage) + kTinyPixels * sizeof(float)) +
         measurements * kMeasurement;
}

IndexedMapPtr index_map(const IndexedMap* previous, MapSnapshotPtr snapshot,
                        std::span<const KeyframeView> views, const GravityOptions& gravity) {
  auto map = std::make_shared<IndexedMap>();
  for (const KeyframeView& view : views) {
    if (snapshot->find(view.id) == nullptr) continue;
    const auto known = previous != nullptr ? find_keyframe(*previous, view.id) : std::nullopt;
    const bool has_image = view.pyramid != nullptr;
    if (!known && !has_image) continue;
    const IndexedKeyframePtr before = known ? previous->keyframes[*known] : nullptr;
    const bool is_same = before && (!has_image || same_measurements(*before, view));
    map->keyframes.push_back(is_same ? before : index_keyframe(view, before.get()));
  }
  std::sort(map->keyframes.begin(), map->keyframes.end(),
            [](const IndexedKeyframePtr& a, const IndexedKeyframePtr& b) { return a->id < b->id; });
  map->images.reserve(map->keyframes.size());
  for (const IndexedKeyframePtr& k : map->keyframes) {
    const auto known = previous != nullptr ? find_keyframe(*previous, k->id) : std::nullopt;
    map->images.push_back(known && previous->keyframes[*known] == k ? previous->images[*known]
                                                                    : make_compact(k->tiny));
  }
  map->is_of_one_size = are_comparable(map->images);
  map->lists = invert(map->keyframes);
  map->positions.reserve(map->keyframes.size());
  for (const IndexedKeyframePtr& k : map->keyframes)
    map->positions.push_back(find_positions(*snapshot, k->measured));
  map->up = up_in_map(*snapshot, views, gravity);
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
      // A map that was purged and comes back from an archive may have other images by the same names.
      if (keyframe && map->images[*keyframe] != forest_->image(static_cast<size_t>(slot - slots.begin())))
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

void PlaceIndex::set_forest(ImageForestPtr forest) {
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

PlaceIndex PlaceIndex::only(const MapSet& maps) const {
  PlaceIndex those;
  for (const IndexedMapPtr& m : maps_) {
    if (maps.contains(m->snapshot->map)) those.put(m);
  }
  return those;
}

bool PlaceIndex::is_within(const MapSet& maps) const {
  return std::ranges::all_of(maps_, [&](const IndexedMapPtr& m) { return maps.contains(m->snapshot->map); });
}

ImageForestPtr plant_forest(const PlaceIndex& index, size_t most_scanned, const ForestOptions& options) {
  if (index.keyframe_count() <= most_scanned) return nullptr;
  std::vector<ImageForest::Image> images;
  images.reserve(index.keyframe_count());
  for (const IndexedMapPtr& map : index.maps()) {
    for (size_t k = 0; k < map->keyframes.size(); ++k)
      images.push_back({map->snapshot->map, map->keyframes[k]->id, map->images[k]});
  }
  return std::make_shared<const ImageForest>(images, options);
}

}  // namespace cairn
