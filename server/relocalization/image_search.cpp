// SPDX-License-Identifier: Apache-2.0
#include "server/relocalization/image_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace cairn {
namespace {

/// [dissimilarity] by which a bound may be wrong: the rounding of float sums over the image, divided by its
/// contrast.
constexpr float kRounding = 1e-3F;

bool is_better(const Ranked& a, const Ranked& b) {
  return std::tie(a.cost, a.map->snapshot->map, a.keyframe) <
         std::tie(b.cost, b.map->snapshot->map, b.keyframe);
}

/// Lower bound of the dissimilarity of images whose compact images are so far apart.
float bound_at(float distance) {
  return 0.5F * distance - kRounding;
}

bool is_nearer(const NearImage& a, const NearImage& b) {
  return a.distance < b.distance;
}

/// The nearest few of the images offered: a heap, the farthest at the front.
class NearestFew {
 public:
  explicit NearestFew(size_t count) : count_(count) { heap_.reserve(count + 1); }

  /// Distance below which an image is of use.
  [[nodiscard]] float limit() const { return is_full() ? heap_.front().distance : kInfinity; }
  [[nodiscard]] bool is_full() const { return heap_.size() == count_; }
  void offer(const NearImage& near) {
    if (!(near.distance < limit())) return;
    heap_.push_back(near);
    std::push_heap(heap_.begin(), heap_.end(), is_nearer);
    if (heap_.size() <= count_) return;
    std::pop_heap(heap_.begin(), heap_.end(), is_nearer);
    heap_.pop_back();
  }
  [[nodiscard]] std::vector<NearImage> take_sorted() {
    std::sort_heap(heap_.begin(), heap_.end(), is_nearer);
    return std::move(heap_);
  }

 private:
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  size_t count_;
  std::vector<NearImage> heap_;
};

/// Calls `found` for each image nearer than `limit()` says by then.
template <typename Limit, typename Found>
void scan(const IndexedMap& map, const CompactImage& query, const Limit& limit, const Found& found) {
  for (uint32_t k = 0; k < map.images.size(); ++k) {
    const float most = limit();
    const float distance = compact_distance(map.images[k], query, most);
    if (distance < most) found(NearImage{distance, {&map, k}});
  }
}

/// The best `count` by exact comparison of those that their bounds do not exclude. `near`: nearest first.
std::vector<Ranked> compare_exactly(const std::vector<NearImage>& near, const QueryImage& query,
                                    size_t count) {
  std::vector<Ranked> best;
  for (const NearImage& n : near) {
    if (best.size() == count && bound_at(n.distance) > best.back().cost) break;
    const Ranked ranked{dissimilarity(*n.place.map->keyframes[n.place.keyframe], query), n.place.map,
                        n.place.keyframe};
    best.insert(std::upper_bound(best.begin(), best.end(), ranked, is_better), ranked);
    if (best.size() > count) best.pop_back();
  }
  return best;
}

NearestFew scan_all(const PlaceIndex& index, const CompactImage& query, size_t count) {
  NearestFew few(count);
  for (const IndexedMapPtr& map : index.maps())
    scan(
        *map, query, [&] { return few.limit(); }, [&](const NearImage& n) { few.offer(n); });
  return few;
}

NearestFew ask_forest(const PlaceIndex& index, const CompactImage& query, size_t count) {
  NearestFew few(count);
  const auto planted = index.planted();
  const auto is_there = [&](uint32_t slot) { return planted[slot].map != nullptr; };
  for (const auto& found : index.forest()->find(query, count, is_there))
    few.offer({found.distance, planted[found.slot]});
  for (const KeyframePlace& place : index.unplanted()) {
    const float distance = compact_distance(place.map->images[place.keyframe], query, few.limit());
    few.offer({distance, place});
  }
  return few;
}

/// All images whose dissimilarity may be `most` or less, nearest first.
std::vector<NearImage> scan_within(const PlaceIndex& index, const CompactImage& query, float most) {
  std::vector<NearImage> within;
  const float limit = 2 * (most + 2 * kRounding);
  for (const IndexedMapPtr& map : index.maps())
    scan(
        *map, query, [&] { return limit; }, [&](const NearImage& n) { within.push_back(n); });
  std::sort(within.begin(), within.end(), is_nearer);
  return within;
}

}  // namespace

QueryImage::QueryImage(TinyImage of)
    : tiny(std::move(of)), contrast(contrast_of(tiny)), compact(make_compact(tiny)) {}

float dissimilarity(const IndexedKeyframe& keyframe, const QueryImage& query) {
  const float difference = tiny_difference(keyframe.tiny, query.tiny);
  if (!std::isfinite(difference)) return difference;
  const float a = keyframe.contrast;
  const float b = query.contrast;
  const float product = 2 * a * b;
  if (!(product > 0)) return 2;
  return 1 - (a * a + b * b - difference) / product;
}

NearImages::NearImages(const PlaceIndex& index, const QueryImage& query, ImageSearch search, size_t images)
    : index_(index),
      query_(query),
      by_forest_(search == ImageSearch::kForest && index.forest() != nullptr),
      images_(std::max<size_t>(1, images)) {
  if (!(query.contrast > 0)) return;
  NearestFew few =
      by_forest_ ? ask_forest(index, query.compact, images_) : scan_all(index, query.compact, images_);
  near_ = few.take_sorted();
}

std::vector<Ranked> NearImages::most_similar(size_t count) const {
  if (count == 0) return {};
  std::vector<Ranked> best = compare_exactly(near_, query_, count);
  if (by_forest_ || near_.size() < images_) return best;  // there are no more
  const float worst = best.size() < count ? std::numeric_limits<float>::infinity() : best.back().cost;
  if (bound_at(near_.back().distance) > worst) return best;
  return compare_exactly(scan_within(index_, query_.compact, worst), query_, count);
}

std::vector<const IndexedMap*> NearImages::maps() const {
  std::vector<const IndexedMap*> maps;
  if (index_.keyframe_count() <= images_ || !(query_.contrast > 0)) {
    for (const IndexedMapPtr& map : index_.maps()) maps.push_back(map.get());
    return maps;
  }
  for (const NearImage& near : near_) maps.push_back(near.place.map);
  for (const IndexedMapPtr& map : index_.maps()) {
    if (map->images.empty()) continue;
    if (!map->is_of_one_size || !is_comparable(map->images.front(), query_.compact))
      maps.push_back(map.get());
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
