// SPDX-License-Identifier: Apache-2.0
#include <malloc.h>

#include <exception>
#include <utility>

#include "server/service/map_service.h"
#include "server/service/resume.h"

/// What the store has kept, taken up at the start; what it gets at the end; and what between need not be in
/// memory, since the store has it.
namespace cairn {

void MapService::resume(std::vector<RestoredMap> restored) {
  resume_clients(restored);
  for (RestoredMap& map : restored) {
    const auto [id, name] = std::pair(map.header.id, map.header.name);
    try {
      take_up(prepare(std::move(map)));
    } catch (const std::exception& problem) {  // memory: the others are served
      store_->leave_alone(id, name, std::string("cannot be served: ") + problem.what());
    }
  }
  if (store_ != nullptr) {
    unloaded_ = store_->unloaded();
    purge_old_maps();
  }
  for (const UnloadedMap& map : unloaded_) maps_.reserve(map.map);
  // All are served all the same: what is there is wanted more than a limit.
  if (std::string why = why_full(); !why.empty()) log_->warn("{}", why);
}

MapService::ResumedMap MapService::prepare(RestoredMap restored) {
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

void MapService::take_up(ResumedMap map) {
  const MapId id = map.header.id;
  MapEntry& entry = maps_.add(id, MapEntry{map.header.name, map.runner, {}, {}, map.plane_aligned});
  entry.maker = std::move(map.maker);
  entry.epochs = std::move(map.epochs);
  entry.labels.restore(map.labels, map.last_label);
  proposals_.restore(id, std::move(map.proposals), map.last_proposal);
  on_map_changed(id, std::move(map.first));
  map.runner->go_on();
}

void MapService::resume_clients(const std::vector<RestoredMap>& restored) {
  std::vector<KeptDecisions> kept;
  kept.reserve(restored.size());
  for (const RestoredMap& map : restored) kept.push_back({map.header.id, map.header.epoch, map.decisions});
  for (auto& [name, resumed] : cairn::resume_clients(kept, kMaxClients)) {
    Client& client = client_of(client_principal(name));
    client.offer_gate.resume(resumed.session, std::move(resumed.offers));
    client.request_gate.resume(resumed.session, std::move(resumed.requests));
    if (resumed.seed) {
      client.seed_gate.resume(*resumed.seed);
    } else {
      client.seed_gate.enter_session(resumed.session);
    }
  }
}

void MapService::let_maps_rest(MonotonicTime now) {
  if (store_ == nullptr || options_.rest_after.count() == 0) return;
  // The allocator keeps most of what is freed here and there otherwise: images lie between what stays. Some
  // milliseconds, with locks that anybody who allocates may wait for: on a thread that does not stand back
  // for others, and beside those that maps and questions wait for.
  if (std::exchange(memory_freed_, false)) store_->run([](Store&) { malloc_trim(0); });
  const auto index = places_->index();
  for (const auto& [map, entry] : maps_.all()) {
    const bool is_awake = entry.statistics.keyframes > entry.statistics.without_images;
    if (entry.runner == nullptr || entry.snapshot == nullptr || !entry.frozen.empty() || !is_awake ||
        now - entry.used_at < options_.rest_after)
      continue;
    const IndexedMap* indexed = index->find(map);
    if (indexed != nullptr) entry.runner->rest({indexed->snapshot->epoch, indexed->snapshot->revision});
  }
}

void MapService::keep_overlaps() {
  static constexpr std::chrono::seconds kRetryAfter(30);  // a full disk is not full for a second only
  if (store_ == nullptr || clock_.now() < overlaps_wait_until_ || !overlaps_.take_changed()) return;
  store_->run([this, log = log_, all = overlaps_.all()](const Store& store) {
    const Status kept = store.keep_overlaps(all);
    if (kept) return;
    log->error("overlaps of maps are not kept: {}; tried again in {} s", kept.error().message,
               kRetryAfter.count());
    post_([this] {
      overlaps_.change_again();
      overlaps_wait_until_ = clock_.now() + kRetryAfter;
    });
  });
}

void MapService::save_last_changes() {
  keep_overlaps();
  for (const auto& [map, entry] : maps_.all()) {
    if (entry.runner) entry.runner->save_last_changes();
  }
}

}  // namespace cairn
