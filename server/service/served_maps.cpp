// SPDX-License-Identifier: Apache-2.0
#include "server/service/served_maps.h"

#include <malloc.h>

#include <algorithm>
#include <utility>

#include "server/service/resume.h"

namespace cairn {

std::shared_ptr<MapRunner> ServedMaps::make_runner(MapId map) {
  const Post& post = context_.post;
  MapRunner::Listener listener;
  listener.changed = [this, map, &post](MapRevision revision) {
    post([this, map, revision = std::move(revision)]() mutable { change(map, std::move(revision)); });
  };
  listener.frozen = [this, map, &post](const std::string& why) {
    post([this, map, why] {
      if (MapEntry* entry = array_.find(map)) entry->failed = why;
    });
  };
  listener.paged = [this, map, &post](MapStatistics now) {
    post([this, map, now = std::move(now)]() mutable {
      MapEntry* entry = array_.find(map);
      if (entry == nullptr) return;
      memory_freed_ = memory_freed_ || now.without_images > entry->statistics.without_images;
      array_.measured(entry, std::move(now));
    });
  };
  return std::make_shared<MapRunner>(
      MapRunner::Executors{context_.executors.urgent, context_.executors.background},
      context_.options.mapping, context_.store, std::move(listener), context_.options.clock, context_.log,
      context_.options.work_times);
}

ResumedMap ServedMaps::prepare(RestoredMap restored) {
  ResumedMap map{restored.header,
                 restored.plane_aligned,
                 std::move(restored.labels),
                 last_label_of(restored.decisions),
                 std::move(restored.proposals),
                 restored.last_proposal,
                 restored.epochs,
                 maker_of(restored.decisions),
                 make_runner(restored.header.id),
                 {}};
  map.first = map.runner->resume(std::move(restored));
  return map;
}

void ServedMaps::take_up(ResumedMap map) {
  const MapId id = map.header.id;
  MapEntry& entry = array_.add(id, MapEntry{map.header.name, map.runner, {}, {}, map.plane_aligned});
  entry.maker = std::move(map.maker);
  entry.epochs = std::move(map.epochs);
  entry.labels.restore(map.labels, map.last_label);
  listener_.restored(map);
  change(id, std::move(map.first));
  map.runner->go_on();
}

std::optional<std::set<LabelId>> ServedMaps::replace(ResumedMap map) {
  const MapId id = map.header.id;
  MapEntry* entry = array_.find(id);
  if (entry == nullptr) return std::nullopt;
  std::set<LabelId> labels;
  for (const Label& label : entry->labels.all()) labels.insert(label.id);
  // Somebody may yet mean by an id a label that the roll-back takes away.
  const LabelId last_given = std::max(entry->labels.last_given(), map.last_label);
  entry->labels = LabelRegistry();
  entry->labels.restore(map.labels, last_given);
  for (const Label& label : entry->labels.all()) labels.insert(label.id);
  listener_.restored(map);
  // Offers to the state before end with the runner that judges them.
  while (entry->offers_in_work > 0) array_.end_offer(entry);
  entry->runner = map.runner;
  entry->plane_aligned = map.plane_aligned;
  entry->epochs = std::move(map.epochs);
  entry->failed.clear();
  entry->rolling_back = false;
  change(id, std::move(map.first));
  entry->runner->go_on();
  return labels;
}

void ServedMaps::change(MapId map, MapRevision revision) {
  MapEntry* entry = array_.find(map);
  if (entry == nullptr) return;  // deleted meanwhile
  if (entry->seeding) {
    entry->undecided = std::move(revision);
    return;
  }
  const MapSnapshotPtr snapshot = revision.snapshot;
  if (entry->snapshot != nullptr && snapshot->epoch < entry->snapshot->epoch)
    return;  // from before a roll-back
  array_.show(entry, snapshot, std::move(revision.statistics));
  entry->used_at = context_.now();
  published_.show(snapshot);
  listener_.shown(map, *entry, std::move(revision));
}

void ServedMaps::forget(MapId map) {
  young_.forget(map);
  const MapEntry* entry = array_.find(map);
  if (entry == nullptr) return;
  const bool was_shown = entry->snapshot != nullptr;
  array_.remove(map);
  published_.remove(map);
  listener_.gone(map, was_shown);
}

void ServedMaps::evict_idle_maps(MonotonicTime now, const PlaceIndex& index) {
  const std::chrono::seconds idle_after = context_.options.idle_after;
  if (context_.store == nullptr || idle_after.count() == 0) return;
  // The allocator keeps most of what is freed here and there otherwise: images lie between what stays. Some
  // milliseconds, with locks that anybody who allocates may wait for: on a thread that does not stand back
  // for others, and beside those that maps and queries wait for.
  if (std::exchange(memory_freed_, false)) context_.store->run([](Store&) { malloc_trim(0); });
  for (const auto& [map, entry] : array_.all()) {
    const bool is_awake = entry.statistics.keyframes > entry.statistics.without_images;
    if (entry.runner == nullptr || entry.snapshot == nullptr || !entry.failed.empty() || !is_awake ||
        now - entry.used_at < idle_after)
      continue;
    const IndexedMap* indexed = index.find(map);
    if (indexed != nullptr)
      entry.runner->evict_images({indexed->snapshot->epoch, indexed->snapshot->revision});
  }
}

void ServedMaps::stop() {
  for (const auto& [map, entry] : array_.all()) {
    if (entry.runner) entry.runner->stop();
  }
}

void ServedMaps::save_last_changes() {
  for (const auto& [map, entry] : array_.all()) {
    if (entry.runner) entry.runner->save_last_changes();
  }
}

}  // namespace cairn
