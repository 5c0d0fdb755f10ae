// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/picture_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace cairn {
namespace {

/// For each keyframe wanted so many are taken by their compact pictures at first.
constexpr size_t kTakenPerWanted = 4;
/// [unlikeness] by which a bound may be wrong: the rounding of float sums over the image, divided by its
/// contrast.
constexpr float kRounding = 1e-3F;

bool is_better(const Ranked& a, const Ranked& b) {
  return std::tie(a.cost, a.map->snapshot->map, a.keyframe) <
         std::tie(b.cost, b.map->snapshot->map, b.keyframe);
}

/// A keyframe and the distance of its compact picture.
struct Near {
  float distance = 0;
  KeyframePlace place;

  /// The unlikeness is not below.
  [[nodiscard]] float bound() const { return 0.5F * distance - kRounding; }
  friend bool operator<(const Near& a, const Near& b) { return a.distance < b.distance; }
};

/// The nearest of what is offered: a heap, the farthest at the front.
class NearestFew {
 public:
  explicit NearestFew(size_t count) : count_(count) { heap_.reserve(count + 1); }

  /// What is not nearer is of no use.
  [[nodiscard]] float limit() const { return is_full() ? heap_.front().distance : kInfinity; }
  [[nodiscard]] bool is_full() const { return heap_.size() == count_; }
  void offer(const Near& near) {
    if (!(near.distance < limit())) return;
    heap_.push_back(near);
    std::push_heap(heap_.begin(), heap_.end());
    if (heap_.size() <= count_) return;
    std::pop_heap(heap_.begin(), heap_.end());
    heap_.pop_back();
  }
  [[nodiscard]] std::vector<Near> take_sorted() {
    std::sort_heap(heap_.begin(), heap_.end());
    return std::move(heap_);
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  size_t count_;
  std::vector<Near> heap_;
};

/// Calls `found` for each picture nearer than `limit()` says by then.
template <typename Limit, typename Found>
void scan(const IndexedMap& map, const CompactPicture& query, const Limit& limit, const Found& found) {
  for (uint32_t k = 0; k < map.pictures.size(); ++k) {
    const float most = limit();
    const float distance = compact_distance(map.pictures[k], query, most);
    if (distance < most) found(Near{distance, {&map, k}});
  }
}

/// The best `count` by exact comparison of those that their bounds do not exclude. `near`: nearest first.
std::vector<Ranked> compare_exactly(const std::vector<Near>& near, const QueryPicture& query, size_t count) {
  std::vector<Ranked> best;
  for (const Near& n : near) {
    if (best.size() == count && n.bound() > best.back().cost) break;
    const Ranked ranked{unlikeness(*n.place.map->keyframes[n.place.keyframe], query), n.place.map,
                        n.place.keyframe};
    best.insert(std::upper_bound(best.begin(), best.end(), ranked, is_better), ranked);
    if (best.size() > count) best.pop_back();
  }
  return best;
}

NearestFew scan_all(const PlaceIndex& index, const CompactPicture& query, size_t count) {
  NearestFew few(count);
  for (const IndexedMapPtr& map : index.maps())
    scan(
        *map, query, [&] { return few.limit(); }, [&](const Near& n) { few.offer(n); });
  return few;
}

NearestFew ask_forest(const PlaceIndex& index, const CompactPicture& query, size_t count) {
  NearestFew few(count);
  const auto planted = index.planted();
  const auto is_there = [&](uint32_t slot) { return planted[slot].map != nullptr; };
  for (const auto& found : index.forest()->find(query, count, is_there))
    few.offer({found.distance, planted[found.slot]});
  for (const KeyframePlace& place : index.unplanted()) {
    const float distance = compact_distance(place.map->pictures[place.keyframe], query, few.limit());
    few.offer({distance, place});
  }
  return few;
}

bool is_asked(const PlaceIndex& index, PictureSearch search) {
  return search == PictureSearch::kForest && index.forest();
}

/// All that may be better than the last of `best`, which a scan for a few has found.
std::vector<Near> scan_within(const PlaceIndex& index, const CompactPicture& query, float unlikeness) {
  std::vector<Near> within;
  const float limit = 2 * (unlikeness + 2 * kRounding);
  for (const IndexedMapPtr& map : index.maps())
    scan(
        *map, query, [&] { return limit; }, [&](const Near& n) { within.push_back(n); });
  std::sort(within.begin(), within.end());
  return within;
}

}  // namespace

QueryPicture::QueryPicture(TinyImage of)
    : tiny(std::move(of)), contrast(contrast_of(tiny)), compact(make_compact(tiny)) {}

float unlikeness(const IndexedKeyframe& keyframe, const QueryPicture& query) {
  const float difference = tiny_difference(keyframe.tiny, query.tiny);
  if (!std::isfinite(difference)) return difference;
  const float a = keyframe.contrast;
  const float b = query.contrast;
  const float product = 2 * a * b;
  if (!(product > 0)) return 2;
  return 1 - (a * a + b * b - difference) / product;
}

std::vector<Ranked> find_alike(const PlaceIndex& index, const QueryPicture& query, size_t count,
                               PictureSearch search) {
  if (count == 0 || !(query.contrast > 0)) return {};
  if (is_asked(index, search)) {
    NearestFew few = ask_forest(index, query.compact, kTakenPerWanted * count);
    return compare_exactly(few.take_sorted(), query, count);
  }
  NearestFew few = scan_all(index, query.compact, kTakenPerWanted * count);
  const float reached = few.limit();  // infinite: all have been taken
  std::vector<Ranked> best = compare_exactly(few.take_sorted(), query, count);
  if (best.empty() || Near{reached, {}}.bound() > best.back().cost) return best;
  return compare_exactly(scan_within(index, query.compact, best.back().cost), query, count);
}

std::vector<const IndexedMap*> find_maps_alike(const PlaceIndex& index, const QueryPicture& query,
                                               size_t pictures, PictureSearch search) {
  std::vector<const IndexedMap*> maps;
  if (index.keyframe_count() <= pictures || !(query.contrast > 0)) {
    for (const IndexedMapPtr& map : index.maps()) maps.push_back(map.get());
    return maps;
  }
  NearestFew few = is_asked(index, search) ? ask_forest(index, query.compact, pictures)
                                           : scan_all(index, query.compact, pictures);
  for (const Near& near : few.take_sorted()) maps.push_back(near.place.map);
  const auto is_of_other_size = [&query](const CompactPicture& picture) {
    return picture.width != query.compact.width || picture.height != query.compact.height;
  };
  for (const IndexedMapPtr& map : index.maps()) {
    if (std::ranges::any_of(map->pictures, is_of_other_size)) maps.push_back(map.get());
  }
  std::sort(maps.begin(), maps.end(),
            [](const IndexedMap* a, const IndexedMap* b) { return a->snapshot->map < b->snapshot->map; });
  maps.erase(std::unique(maps.begin(), maps.end()), maps.end());
  return maps;
}

Ranked find_nearest(const PlaceIndex& index, const TinyImage& tiny) {
  Ranked best{std::numeric_limits<float>::infinity(), nullptr, 0};
  for (const IndexedMapPtr& map : index.maps()) {
    for (size_t k = 0; k < map->keyframes.size(); ++k) {
      const float cost = tiny_difference(map->keyframes[k]->tiny, tiny);
      if (cost < best.cost) best = {cost, map.get(), k};
    }
  }
  return best;
}

}  // namespace cairn
