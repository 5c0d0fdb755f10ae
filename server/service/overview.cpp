// SPDX-License-Identifier: Apache-2.0
#include "server/service/overview.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/base/utc.h"
#include "common/base/utf8.h"
#include "common/base/version.h"
#include "server/service/store_tasks.h"

namespace cairn {
namespace {

using nlohmann::json;

constexpr size_t kMostOverlapsTold = 100;  ///< of a map: it must fit into a page

/// Onto a page, from a number on, as many as fit.
template <typename Item, typename Describe>
void add_from(size_t begin, const std::vector<Item>& items, const char* list, ReplyPage* page,
              Describe describe_one) {
  for (size_t i = begin; i < items.size(); ++i) {
    if (!page->add(list, describe_one(items[i]))) return;
  }
}

/// What stands beside the health; `maps` has all.
template <typename Item, typename Describe>
json first_of(const std::vector<Item>& items, Describe describe_one) {
  constexpr size_t kMostTold = 10;
  json told = json::array();
  for (size_t i = 0; i < std::min(items.size(), kMostTold); ++i) told.push_back(describe_one(items[i]));
  return told;
}

const char* word_of(TrackingState state) {
  switch (state) {
    case TrackingState::kTracking:
      return "tracking";
    case TrackingState::kPoor:
      return "poor";
    case TrackingState::kLost:
      return "lost";
    case TrackingState::kRotation:
      return "rotation";
    case TrackingState::kStarting:
      break;
  }
  return "starting";
}

}  // namespace

wire::AdminReply Overview::server() const {
  json clients = json::array();
  json wearers = json::object();
  for (const auto& [name, client] : clients_.all()) {
    if (!client.connected) continue;
    clients.push_back(name);
    if (const std::string wearer = sessions_.wearers().wearer_of(name); !wearer.empty())
      wearers[name] = wearer;
  }
  const auto is_served = [this](const DamagedFile& file) { return maps_.all().contains(file.map); };
  json damaged = first_of(health_.damaged(),
                          [&](const DamagedFile& file) { return cairn::describe(file, is_served(file)); });
  const MapServiceOptions& options = context_.options;
  return success({{"server", to_hex(options.server.bytes)},
                  {"version", std::string(version())},
                  {"start_count", options.start_count},
                  {"health", health_.words()},
                  {"store", context_.store ? one_line(context_.store->folder().string()) : std::string()},
                  {"maps", maps_.live_count()},
                  {"maps_at_rest", maps_.resting_count()},
                  {"memory_bytes", maps_.bytes()},
                  {"limits",
                   {{"maps", options.max_maps},
                    {"memory_bytes", options.max_memory_bytes},
                    {"rest_after_s", context_.store ? options.rest_after.count() : 0}}},
                  {"damaged", std::move(damaged)},
                  {"damaged_files", health_.damaged().size()},
                  {"unloaded",
                   first_of(health_.unloaded(), [](const UnloadedMap& map) { return cairn::describe(map); })},
                  {"unloaded_maps", health_.unloaded().size()},
                  {"clients", std::move(clients)},
                  {"wearers", std::move(wearers)}});
}

wire::AdminReply Overview::clients() const {
  const Rights::Table rights = context_.site.rights().table();
  const MonotonicTime now = context_.now();
  json clients = json::array();
  for (const auto& [name, client] : clients_.all()) {
    json told{{"name", name},
              {"connected", client.connected},
              {"proven", client.proof == Principal::Proof::kProven},
              {"blocked", rights.blocked.contains(name)}};
    if (const std::string wearer = sessions_.wearers().wearer_of(name); !wearer.empty())
      told["wearer"] = wearer;
    if (client.last_word && is_fresh(*client.last_word, now)) {
      told["state"] = word_of(client.last_word->state);
      told["quality"] = client.last_word->quality;
      if (const auto map = maps_.all().find(client.last_word->map); map != maps_.all().end())
        told["map"] = map->second.name;
    }
    clients.push_back(std::move(told));
  }
  for (const auto& [name, closure] : rights.blocked) {
    if (!clients_.all().contains(name))
      clients.push_back({{"name", name}, {"connected", false}, {"blocked", true}});
  }
  return success({{"clients", std::move(clients)}});
}

size_t Overview::count_in(MapId map) const {
  const MonotonicTime now = context_.now();
  return static_cast<size_t>(std::ranges::count_if(clients_.all(), [&](const auto& known) {
    const std::optional<Client::Word>& word = known.second.last_word;
    return known.second.connected && word && word->is_proven && word->map == map && is_fresh(*word, now);
  }));
}

json Overview::describe(MapId id, const MapEntry& entry) const {
  json map = cairn::describe(id, entry);
  const auto corner = [](const Eigen::Vector3f& at) { return json{at.x(), at.y(), at.z()}; };
  map["bounds"] = {{"min", corner(entry.statistics.bounds_min)},
                   {"max", corner(entry.statistics.bounds_max)}};
  map["clients"] = count_in(id);
  if (entry.localized_at) map["localized"] = to_utc(*entry.localized_at);
  map["offers_accepted"] = entry.offer_times.accepted();
  if (const auto wait = entry.offer_times.wait_ms(0.5)) map["offer_p50_ms"] = *wait;
  if (const auto wait = entry.offer_times.wait_ms(0.95)) map["offer_p95_ms"] = *wait;
  json& overlaps = map["overlaps"] = json::array();
  for (const OverlapList::Neighbour& neighbour : places_.overlaps_of(id)) {
    const auto known = maps_.all().find(neighbour.map);
    if (known == maps_.all().end() || known->second.snapshot == nullptr) continue;  // deleted
    if (overlaps.size() < kMostOverlapsTold)
      overlaps.push_back(cairn::describe(neighbour, known->second.name));
  }
  return map;
}

void Overview::list(const asked::Maps& begin, const AdminAnswer& answer) {
  ReplyPage page{"maps", "deleted", "damaged", "unloaded"};
  std::set<MapId> served;
  bool has_room = true;
  for (const auto& [id, entry] : maps_.all()) {
    if (entry.snapshot == nullptr) continue;
    served.insert(id);
    has_room = has_room && (to_hex(id.bytes) <= begin.after || page.add("maps", describe(id, entry)));
  }
  if (context_.store == nullptr || page.content()["more"]) return answer(success(page.content()));
  const auto look = [this, answer, begin, served, page](const Store& store) -> Task {
    return [this, answer, begin, served, page, deleted = store.deleted_maps(),
            damaged = store.damaged_files(), unloaded = context_.store->unloaded()]() mutable {
      add_from(begin.deleted_from, deleted, "deleted", &page,
               [](const DeletedMap& map) { return cairn::describe(map); });
      add_from(begin.damaged_from, damaged, "damaged", &page,
               [&](const DamagedFile& file) { return cairn::describe(file, served.contains(file.map)); });
      add_from(begin.unloaded_from, unloaded, "unloaded", &page,
               [](const UnloadedMap& map) { return cairn::describe(map); });
      health_.note(std::move(damaged), std::move(unloaded));
      answer(success(page.content()));
    };
  };
  beside_store(context_, answer, look);
}

void Overview::show(MapId id, const MapEntry& entry, const AdminAnswer& answer) const {
  json map = describe(id, entry);
  map["labels"] = entry.labels.all().size();
  if (entry.runner == nullptr) return answer(success(map));
  entry.runner->measure([this, map = std::move(map), answer](const MapMeasures& measures) {
    context_.post([map, answer, measures]() mutable {
      map["reprojection_px"] = measures.reprojection_rms;
      map["cameras"] = cairn::describe(measures.cameras);
      answer(success(map));
    });
  });
}

}  // namespace cairn
