// SPDX-License-Identifier: Apache-2.0
#include "server/service/overlap_watch.h"

#include <algorithm>
#include <utility>

#include "common/base/cpu_time.h"
#include "common/image/place.h"

namespace cairn {
namespace {

constexpr size_t kMostWaiting = 8;  ///< of a map: their images are held meanwhile, 0.4 MB each

/// Whatever method trackers are answered by: one that confirms nothing finds a place in any image.
RelocOptions confirming(RelocOptions options) {
  options.method = RelocMethod::kImproved;
  return options;
}

}  // namespace

OverlapWatch::OverlapWatch(Executor& executor, const RelocOptions& options, IndexSource index,
                           Listener listener, Logger log, WorkTimes* times)
    : executor_(executor),
      options_(confirming(options)),
      index_(std::move(index)),
      listener_(std::move(listener)),
      log_(std::move(log)),
      times_(times),
      detector_(options.overlap) {}

void OverlapWatch::note_searched(const IndexedMapPtr& map, std::span<const KeyframeView> views) {
  const MapId id = map->snapshot->map;
  const std::scoped_lock lock(mutex_);
  searched_[id] = map;
  KeyframeId& newest = newest_[id];
  for (const KeyframeView& view : views) {
    if (view.id <= newest) continue;
    newest = view.id;
    if (view.pyramid == nullptr || view.corners == nullptr) continue;
    std::deque<KeyframeView>& waiting = waiting_[id];
    waiting.push_back({view.id, view.camera, view.pyramid, {}, view.corners});
    if (waiting.size() > kMostWaiting) {
      waiting.pop_front();
    } else {
      executor_.submit([self = shared_from_this(), id] { self->check(id); });
    }
  }
}

void OverlapWatch::remove(const MapId& map) {
  const std::scoped_lock lock(mutex_);
  removed_.insert(map);
  searched_.erase(map);
  newest_.erase(map);
  waiting_.erase(map);
}

std::optional<KeyframeView> OverlapWatch::take_waiting(const MapId& map) {
  std::set<MapId> removed;
  std::map<MapId, IndexedMapPtr> searched;
  std::optional<KeyframeView> keyframe;
  {
    const std::scoped_lock lock(mutex_);
    removed.swap(removed_);
    searched.swap(searched_);
    if (const auto waiting = waiting_.find(map); waiting != waiting_.end() && !waiting->second.empty()) {
      keyframe = std::move(waiting->second.front());
      waiting->second.pop_front();
    }
  }
  for (const MapId& id : removed) detector_.remove(id);
  for (const auto& [_, indexed] : searched) detector_.note_searched(*indexed);
  return keyframe;
}

void OverlapWatch::check(const MapId& map) {
  const auto before = thread_cpu_time();
  const std::scoped_lock one_at_a_time(checking_);
  const auto keyframe = take_waiting(map);
  if (!keyframe || !look_up(map, *keyframe) || times_ == nullptr) return;
  times_->checked_for_overlaps(thread_cpu_time() - before);
}

bool OverlapWatch::look_up(const MapId& map, const KeyframeView& keyframe) {
  const uint64_t time = detector_.now();
  const auto index = index_();
  PlaceIndex others = *index;
  others.remove(map);
  if (others.keyframe_count() == 0) return false;
  const auto found = find_in_each_map(std::move(others), *keyframe.camera,
                                      describe_place(*keyframe.pyramid, *keyframe.corners), options_);
  for (const PlaceCandidate& place : found)
    log_->debug("keyframe {} of map {} is in map {} as well, near its keyframe {}", keyframe.id.value,
                to_hex(map.bytes), to_hex(place.map.bytes), place.keyframe.value);
  for (const Overlap& overlap : detector_.note_answer(map, keyframe.id, time, found, *index))
    listener_(overlap);
  return true;
}

}  // namespace cairn
