// SPDX-License-Identifier: Apache-2.0
#include "server/service/overview.h"

#include <algorithm>
#include <set>
#include <utility>

#include "common/base/version.h"
#include "server/service/store_tasks.h"

namespace cairn {
namespace {

constexpr size_t kMostOverlapsTold = 100;  ///< of a map: it must fit into a page
/// More than fit into a page: each takes some 260 bytes at least.
constexpr size_t kMostMapsTold = 250;

/// The first items of a list, which stand beside the health; the request `maps` tells all.
template <typename Item>
std::vector<Item> first_of(const std::vector<Item>& items) {
  constexpr size_t kMostTold = 10;
  return {items.begin(), items.begin() + static_cast<ptrdiff_t>(std::min(items.size(), kMostTold))};
}

template <typename Item>
std::vector<Item> from(size_t begin, const std::vector<Item>& items) {
  return {items.begin() + static_cast<ptrdiff_t>(std::min(begin, items.size())), items.end()};
}

/// `is_served`: of a map.
template <typename IsServed>
std::vector<told::DamagedSeen> seen(const std::vector<DamagedFile>& files, IsServed is_served) {
  std::vector<told::DamagedSeen> all;
  for (const DamagedFile& file : files) all.push_back({file, is_served(file.map)});
  return all;
}

}  // namespace

told::Map describe_map(MapId id, const MapEntry& entry) {
  return {.id = id,
          .name = entry.name,
          .keyframes = entry.snapshot->keyframe_count(),
          .points = entry.snapshot->point_count(),
          .epoch = entry.snapshot->epoch,
          .revision = entry.snapshot->revision,
          .memory_bytes = bytes_of(entry),
          .is_idle = is_idle(entry),
          .plane_aligned = entry.plane_aligned,
          .failed = entry.failed};
}

told::Server Overview::server() const {
  const MapServiceOptions& options = context_.options;
  told::Server told{
      .server = options.server,
      .version = std::string(version()),
      .start_count = options.start_count,
      .health = health_.words(),
      .store = context_.store ? context_.store->folder() : std::filesystem::path(),
      .maps = maps_.live_count(),
      .idle_maps = maps_.idle_count(),
      .memory_bytes = maps_.bytes(),
      .max_maps = options.max_maps,
      .max_memory_bytes = options.max_memory_bytes,
      .idle_after = context_.store ? options.idle_after : std::chrono::seconds(0),
      .damaged = seen(first_of(health_.damaged()), [this](MapId map) { return maps_.all().contains(map); }),
      .damaged_files = health_.damaged().size(),
      .unloaded = first_of(health_.unloaded()),
      .unloaded_maps = health_.unloaded().size(),
      .clients = {},
      .wearers = {}};
  for (const auto& [name, client] : clients_.all()) {
    if (!client.connected) continue;
    told.clients.push_back(name);
    if (const std::string wearer = sessions_.wearers().wearer_of(name); !wearer.empty())
      told.wearers[name] = wearer;
  }
  return told;
}

told::Clients Overview::clients() const {
  const Rights::Table rights = context_.site.rights().table();
  const MonotonicTime now = context_.now();
  told::Clients told;
  for (const auto& [name, client] : clients_.all()) {
    const bool is_proven = client.proof == Principal::Proof::kProven;
    told::ClientSeen seen{
        .name = name,
        .blocked = rights.blocked.contains(name),
        .revoked = clients_.turned_away().contains(name),
        .known = told::ClientSeen::Known{client.connected, is_proven, sessions_.wearers().wearer_of(name)},
        .tracker = {}};
    if (client.last_word && is_fresh(*client.last_word, now)) {
      seen.tracker = {client.last_word->state, client.last_word->quality, {}};
      if (const auto map = maps_.all().find(client.last_word->map); map != maps_.all().end())
        seen.tracker->map = map->second.name;
    }
    told.clients.push_back(std::move(seen));
  }
  std::set<std::string> kept_out = clients_.turned_away();
  for (const auto& [name, closure] : rights.blocked) kept_out.insert(name);
  for (const std::string& name : kept_out) {
    if (clients_.all().contains(name)) continue;
    told.clients.push_back({.name = name,
                            .blocked = rights.blocked.contains(name),
                            .revoked = clients_.turned_away().contains(name),
                            .known = {},
                            .tracker = {}});
  }
  return told;
}

size_t Overview::count_in(MapId map) const {
  const MonotonicTime now = context_.now();
  return static_cast<size_t>(std::ranges::count_if(clients_.all(), [&](const auto& known) {
    const std::optional<Client::Word>& word = known.second.last_word;
    return known.second.connected && word && word->is_verified && word->map == map && is_fresh(*word, now);
  }));
}

told::BusyMap Overview::describe(MapId id, const MapEntry& entry) const {
  told::BusyMap busy{.map = describe_map(id, entry),
                     .frozen = context_.access().why_frozen(id),
                     .bounds_min = entry.statistics.bounds_min,
                     .bounds_max = entry.statistics.bounds_max,
                     .clients = count_in(id),
                     .localized = entry.localized_at,
                     .offers_accepted = entry.offer_times.accepted(),
                     .offer_p50_ms = entry.offer_times.wait_ms(0.5),
                     .offer_p95_ms = entry.offer_times.wait_ms(0.95),
                     .overlaps = {}};
  for (const OverlapList::Neighbour& neighbour : places_.overlaps_of(id)) {
    const auto known = maps_.all().find(neighbour.map);
    if (known == maps_.all().end() || known->second.snapshot == nullptr) continue;  // deleted
    if (busy.overlaps.size() < kMostOverlapsTold)
      busy.overlaps.push_back(
          {known->second.name, neighbour.map, neighbour.keyframes, neighbour.its_keyframes, neighbour.found});
  }
  return busy;
}

void Overview::list(const asked::Maps& begin, const AdminAnswer& answer) {
  told::Maps page;
  std::set<MapId> served;
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot == nullptr) continue;
    served.insert(id);
    if (to_hex(id.bytes) > begin.after && page.maps.size() < kMostMapsTold)
      page.maps.push_back(describe(id, entry));
  }
  const bool is_full = page.maps.size() >= kMostMapsTold;
  if (context_.store == nullptr || is_full) return answer(std::move(page));
  const auto look = [this, answer, begin, served, page = std::move(page)](const Store& store) -> Task {
    return [this, answer, begin, served, page, deleted = store.deleted_maps(),
            damaged = store.damaged_files(), unloaded = context_.store->opening().unloaded()]() mutable {
      page.deleted = from(begin.deleted_from, deleted);
      page.damaged = seen(from(begin.damaged_from, damaged), [&](MapId map) { return served.contains(map); });
      page.unloaded = from(begin.unloaded_from, unloaded);
      health_.note(std::move(damaged), std::move(unloaded));
      answer(std::move(page));
    };
  };
  on_store_strand(context_, answer, look);
}

void Overview::show(MapId id, const MapEntry& entry, const AdminAnswer& answer) const {
  told::WholeMap whole{describe(id, entry), entry.labels.all().size(), {}};
  if (entry.runner == nullptr) return answer(std::move(whole));
  entry.runner->measure([this, whole = std::move(whole), answer](const MapMeasures& measures) {
    context_.post([whole, answer, measures]() mutable {
      whole.measures = {measures.reprojection_rms, measures.cameras};
      answer(std::move(whole));
    });
  });
}

}  // namespace cairn
