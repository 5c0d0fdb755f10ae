// SPDX-License-Identifier: Apache-2.0
#include "server/service/map_service.h"

#include <exception>
#include <utility>

#include "common/base/version.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTick{200};  // ServerStatus at 5 Hz asserts our liveliness (lease 1 s)
constexpr int kTicksPerMapInfo = 5;
constexpr int kTicksPerExpiry = 300;  // a minute

}  // namespace

MapService::MapService(const MapServiceOptions& options, Executors executors, MapPersistence* store,
                       SiteAccess& site, ServiceOutput& output, Post post, Logger log)
    : context_{options, executors, store, site, output, std::move(post), std::move(log)},
      maps_(context_),
      capacity_(context_.options, maps_.array()),
      clients_(context_),
      sessions_(context_, clients_, maps_),
      proposals_(context_, clients_, maps_.array()),
      news_(context_, maps_.array(), clients_),
      labels_(context_, clients_, sessions_, maps_),
      places_(context_, clients_, sessions_, maps_),
      commands_(context_, clients_, sessions_, maps_, capacity_, news_, proposals_),
      health_(context_, maps_.array()),
      overview_(context_, maps_.array(), clients_, sessions_, places_, health_),
      map_administration_(context_, maps_, news_, capacity_, places_, health_, overview_),
      archives_(context_, capacity_, map_administration_),
      versions_(context_, maps_, labels_, capacity_, map_administration_, overview_),
      store_administration_(context_, maps_.array(), archives_),
      site_administration_(context_, maps_.array(), clients_, news_),
      label_administration_(labels_),
      proposal_administration_(context_, maps_, capacity_, proposals_.registry()),
      operators_(context_, maps_.array(),
                 {overview_, sessions_, rigs_, site_administration_, map_administration_, archives_,
                  versions_, label_administration_, proposal_administration_, store_administration_}),
      next_tick_(context_.now()) {
  listen();
  if (store == nullptr) return;
  for (const MapId map : store->at_start().deleted_ids) maps_.array().ids().reserve(map);
}

/// Who is told of what happens in another's part.
void MapService::listen() {
  clients_.listen({[this](Client& client) { on_newcomer(client); },
                   [this](const std::string& name) { sessions_.left(name); }});
  maps_.listen({[this](ResumedMap& map) {
                  proposals_.registry().restore(map.header.id, std::move(map.proposals), map.last_proposal);
                },
                [this](MapId map, MapEntry& entry, MapRevision revision) {
                  on_map_shown(map, entry, std::move(revision));
                },
                [this](MapId map, bool was_shown) { on_map_gone(map, was_shown); }});
  context_.site.run_by({context_.executors.site, [this](Task task) { context_.post(std::move(task)); }});
}

void MapService::resume(std::vector<RestoredMap> restored) {
  using Deleted = std::vector<DeletedDecisions>;
  clients_.resume(restored, context_.store ? context_.store->opening().decisions_on_deleted() : Deleted());
  for (RestoredMap& map : restored) {
    const auto [id, name] = std::pair(map.header.id, map.header.name);
    try {
      maps_.take_up(maps_.prepare(std::move(map)));
    } catch (const std::exception& problem) {  // memory: the others are served
      context_.store->opening().leave_alone(id, name, std::string("cannot be served: ") + problem.what());
    }
  }
  health_.note_restored();
  if (context_.store != nullptr) map_administration_.purge_old();
  for (const UnloadedMap& map : health_.unloaded()) maps_.array().ids().reserve(map.map);
  // All are served all the same: what is there is wanted more than a limit.
  if (std::string why = capacity_.why_full(); !why.empty()) context_.log->warn("{}", why);
}

void MapService::stop() {
  maps_.stop();
}

void MapService::save_last_changes() {
  places_.keep_overlaps();
  maps_.save_last_changes();
}

void MapService::publish(MapSnapshotPtr snapshot) {
  const MapId map = snapshot->map;
  if (maps_.array().find(map) == nullptr) maps_.array().add(map, MapEntry{snapshot->name, {}, {}, {}, {}});
  maps_.change(map, {std::move(snapshot), {}, {}});
}

void MapService::on_newcomer(Client& client) {
  next_tick_ = context_.now();  // it learns at once who serves it
  news_.tell_newcomer(client);
}

/// From here, not from the map's queue: a map that has gone does not come back, and no verdict is ahead.
void MapService::on_map_shown(MapId map, MapEntry& entry, MapRevision revision) {
  if (entry.runner != nullptr) places_.note_revised(std::move(revision));
  labels_.follow(map, entry);
  news_.note_revised(map, entry);
  context_.output.revised(map, entry.snapshot);
}

void MapService::on_map_gone(MapId map, bool was_shown) {
  proposals_.registry().forget(map);
  if (!was_shown) return;
  places_.remove(map);
  context_.output.ended(map);
  news_.tell_gone(map);
}

void MapService::tick(MonotonicTime now) {
  next_tick_ = now + kTick;
  context_.site.try_again();
  if (context_.site.has_changed()) enforce_rights(context_, clients_, news_);
  clients_.tell_status({context_.options.server, context_.options.start_count, std::string(version()),
                        health_.words(), static_cast<uint32_t>(sessions_.live_count(now)),
                        static_cast<uint32_t>(maps_.array().live_count()),
                        context_.executors.urgent.take_load()});
  if (++ticks_ % kTicksPerExpiry == 0 && context_.store != nullptr) {
    archives_.expire();
    health_.look_again();
    proposals_.drop_old();
    map_administration_.purge_old();
    versions_.compact_crowded(now);
  }
  if (ticks_ % kTicksPerMapInfo != 0) return;
  for (const std::string& line : rigs_.pass(now)) context_.log->info("{}", line);
  maps_.evict_idle_maps(now, *places_.index());
  map_administration_.drop_dead(now);
  places_.keep_overlaps();
  news_.tell_due();
}

void MapService::take(const Principal& who, wire::MapSeed seed) {
  commands_.take(who, std::move(seed));
}

void MapService::take(const Principal& who, wire::KeyframeOffer offer) {
  commands_.take(who, std::move(offer));
}

void MapService::take(const Principal& who, wire::RelocQuery query) {
  places_.take(who, std::move(query));
}

void MapService::take(const Principal& who, const wire::ClientRequest& request) {
  labels_.take(who, request);
}

void MapService::take(const Principal& who, const wire::AdminRequest& request) {
  operators_.take(who, request);
}

void MapService::take(const wire::RigState& rig) {
  for (const std::string& line : rigs_.heard(rig, context_.now())) context_.log->info("{}", line);
}

}  // namespace cairn
