// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/utc.h"
#include "server/service/admin_reply.h"
#include "server/service/map_service.h"

/// What operators ask about who may do what, and how it comes into force.
namespace cairn {

using nlohmann::json;

namespace {

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

std::optional<NamedMap> MapService::named_map(const std::string& name_or_id) {
  const auto [id, entry] = find_map(name_or_id);
  if (entry == nullptr) return std::nullopt;
  const MapStatistics& now = entry->statistics;
  return NamedMap{id, entry->name, {now.bounds_min.cast<double>(), now.bounds_max.cast<double>()}};
}

bool MapService::administers_access(const std::string& operator_name, const std::string& verb,
                                    const json& request, const AdminAnswer& answer) {
  const FindMap find = [this](const std::string& name) { return named_map(name); };
  const auto tell = [&](const Result<json>& content) {
    answer(content ? success(*content) : refusal(content.error()));
  };
  if (changes_rights(verb)) {
    auto change = change_rights(site_.rights(), request, operator_name, find, site_.policy()->now());
    if (!change) {
      answer(refusal(change.error()));
      return true;
    }
    site_.put(std::move(*change), [this, answer, done = change->answer](const Status& kept) {
      if (!kept) return answer(refusal(kept.error()));
      enforce_rights();
      answer(success(done));
    });
    return true;
  }
  if (verb == "rights") {
    json content = describe_rights(
        site_.rights(),
        [this](const MapId& map) {
          const MapEntry* entry = maps_.find(map);
          return entry == nullptr ? std::string() : entry->name;
        },
        site_.policy()->now());
    if (const auto& since = site_.secured_since()) {
      content["secured"] = to_utc(*since);
      content["note"] =
          "a secured site since " + to_utc(*since) + "; what everyone had been allowed before is withdrawn";
    }
    if (!site_.is_kept()) content["note"] = "this server has no --store: its rights are gone when it ends";
    answer(success(content));
    return true;
  }
  if (verb == "rights-explain") {
    tell(explain_rights(site_.rights(), request, find, site_.policy()->now()));
    return true;
  }
  if (verb == "client-kick") {
    tell(
        kick_client(request.value("client", json()).is_string() ? request["client"].get<std::string>() : ""));
    return true;
  }
  if (verb == "clients") {
    answer(success(describe_clients()));
    return true;
  }
  if (verb != "audit") return false;
  const auto query = audit_query_of(request);
  if (!query) {
    answer(refusal(query.error()));
    return true;
  }
  site_.find(*query, [answer](const Result<std::vector<AuditEntry>>& found) {
    if (!found) return answer(refusal(found.error()));
    ReplyPage page{"entries"};
    for (const AuditEntry& entry : *found) {
      if (!page.add("entries", describe(entry))) break;  // the next page begins before the last of these
    }
    answer(success(page.content()));
  });
  return true;
}

json MapService::describe_clients() const {
  const Rights::Table rights = site_.rights().table();
  json clients = json::array();
  for (const auto& [name, client] : clients_) {
    json told{{"name", name},
              {"connected", client.connected},
              {"proven", client.proof == Principal::Proof::kProven},
              {"blocked", rights.blocked.contains(name)}};
    if (const std::string wearer = wearers_.wearer_of(name); !wearer.empty()) told["wearer"] = wearer;
    if (client.last_word && is_fresh(*client.last_word)) {
      told["state"] = word_of(client.last_word->state);
      told["quality"] = client.last_word->quality;
      if (const auto map = maps_.all().find(client.last_word->map); map != maps_.all().end())
        told["map"] = map->second.name;
    }
    clients.push_back(std::move(told));
  }
  for (const auto& [name, closure] : rights.blocked) {
    if (!clients_.contains(name))
      clients.push_back({{"name", name}, {"connected", false}, {"blocked", true}});
  }
  return {{"clients", std::move(clients)}};
}

bool MapService::is_fresh(const Client::Word& word) const {
  return clock_.now() - word.at < Presence::kSilence;
}

size_t MapService::count_in(MapId map) const {
  return static_cast<size_t>(std::count_if(clients_.begin(), clients_.end(), [&](const auto& entry) {
    const std::optional<Client::Word>& word = entry.second.last_word;
    return entry.second.connected && word && word->is_proven && word->map == map && is_fresh(*word);
  }));
}

/// The process that holds the name now is not served any more; another may come.
Result<json> MapService::kick_client(const std::string& name) {
  const auto found = clients_.find(name);
  if (found == clients_.end() || !found->second.connected || !found->second.last_word)
    return fail(ErrorCode::kNotFound,
                "client '" + name + "' is not connected; `cairnctl clients` lists them");
  Client& client = found->second;
  client.kicked = client.last_word->session;
  client.last_word.reset();
  presence_.gone(name);
  wearers_.left(name);
  young_.left(name);
  tell_kicked(client);
  return json{{"done", "client " + name + " is not served until it is started again"}};
}

void MapService::tell_kicked(Client& client) {
  const MonotonicTime now = clock_.now();
  if (client.intruder_told_at && now - *client.intruder_told_at < Presence::kSilence) return;
  client.intruder_told_at = now;
  const std::string reason = "an operator has ended this; start the tracker again to go on";
  (void)this->tell(client, wire::OfferVerdict{client.id, *client.kicked, 0, 0, {notice_to_process(reason)}});
  client.repeat_verdicts = true;
}

/// What a client may no longer read is taken from it at once, and what it may read now is offered.
void MapService::enforce_rights() {
  for (auto& [name, client] : clients_) {
    client.pending_offers.withdraw([&](const PendingOffers::What& what) {
      if (what.kind == PendingOffers::Kind::kProposal)
        return !options_.access->may_propose(client.principal(), what.map);
      const bool is_seed = what.kind == PendingOffers::Kind::kSeed;
      const Ruling now = is_seed ? options_.access->on_creating(client.principal())
                                 : options_.access->in_map(client.principal(), what.map);
      return now.right < (is_seed ? Right::kWrite : Right::kAdd) || now.extent != what.extent;
    });
    for (const auto& [map, entry] : maps_.all()) {
      if (entry.snapshot == nullptr) continue;
      if (options_.access->may_read(client.principal(), map)) {
        list_map(map, entry, client);
        if (client.connected) tell_cameras(map, entry);
      } else {
        unlist_map(map, client);
      }
    }
  }
}

/// A map that it was never told of is not named to it now.
void MapService::unlist_map(MapId map, Client& client) {
  const bool was_listed = client.maps_told.erase(map) > 0;
  tell(client, MapUnlisted{map, was_listed});
  forget_cameras(map, client);
}

void MapService::withdraw_offers(const std::function<bool(const std::string& client)>& is_turned_away) {
  for (auto& [name, client] : clients_) {
    if (is_turned_away(name)) client.pending_offers.withdraw([](const PendingOffers::What&) { return true; });
  }
}

void MapService::note_refused(const std::string& who, const std::string& why) {
  log_->warn("{} was not let in: {}", who, why);
  site_.note({0, site_.policy()->now(), who, "not let in", {}, why});
}

void MapService::note_turned_away(const Principal& who, const std::string& why) {
  const bool is_client = who.kind == Principal::Kind::kClient;
  const std::string object = (is_client ? "client " : "operator ") + who.name;
  log_->warn("{} is turned away: {}", object, why);
  site_.note({0, site_.policy()->now(), object, "turned away", {}, why});
}

MapService::AdminAnswer MapService::audited(const std::string& operator_name, const std::string& verb,
                                            const json& request, const AdminAnswer& tell) {
  AuditEntry entry{0, {}, "operator " + operator_name, verb, {}, {}};
  std::replace(entry.action.begin(), entry.action.end(), '-', ' ');
  if (const auto map = request.find("map"); map != request.end() && map->is_string())
    entry.object = "map " + map->get<std::string>();
  for (const char* part : {"tag", "name", "client", "proposal"}) {
    const auto named = request.find(part);
    if (named != request.end() && named->is_string() && !named->get<std::string>().empty())
      entry.object +=
          (entry.object.empty() ? "" : ", ") + std::string(part) + " " + named->get<std::string>();
  }
  return [this, entry, tell, is_kept_with_rights = changes_rights(verb)](wire::AdminReply reply) mutable {
    const bool is_done = reply.result == 0;
    if (!is_done || !is_kept_with_rights) {
      entry.time = site_.policy()->now();
      entry.outcome = is_done ? "done" : reply.text;
      site_.note(entry);
    }
    tell(std::move(reply));
  };
}

}  // namespace cairn
