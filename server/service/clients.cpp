// SPDX-License-Identifier: Apache-2.0
#include "server/service/clients.h"

#include <utility>
#include <vector>

#include "common/wire/limits.h"
#include "server/service/fitting_words.h"
#include "server/service/resume.h"

namespace cairn {
namespace {

/// Puts a notice before the outcomes that were decided, of which the oldest gives way.
void put_notice(wire::OfferOutcome notice, std::vector<wire::OfferOutcome>* recent) {
  if (recent->size() >= wire::kMaxOutcomes) recent->erase(recent->begin());
  recent->insert(recent->begin(), std::move(notice));
}

}  // namespace

Client& Clients::of(const Principal& who) {
  const std::string& name = who.name;
  const auto [it, is_new] = clients_.try_emplace(name, context_.options.rates);
  if (is_new) {
    it->second.name = name;
    it->second.id = client_id_from_name(name);
    it->second.left_at = context_.now();
    names_[it->second.id] = name;
    forget_old(name);
  }
  it->second.proof = who.proof;
  return it->second;
}

Client* Clients::find(const std::string& name) {
  const auto found = clients_.find(name);
  return found == clients_.end() ? nullptr : &found->second;
}

Client* Clients::find(ClientId id) {
  const auto name = names_.find(id);
  return name == names_.end() ? nullptr : find(name->second);
}

void Clients::forget_old(const std::string& keep) {
  while (clients_.size() > kMaxClients) {
    auto oldest = clients_.end();
    for (auto it = clients_.begin(); it != clients_.end(); ++it) {
      if (!it->second.connected && it->first != keep &&
          (oldest == clients_.end() || it->second.left_at < oldest->second.left_at))
        oldest = it;
    }
    if (oldest == clients_.end()) return;
    listener_.left(oldest->first);
    names_.erase(oldest->second.id);
    clients_.erase(oldest);
  }
}

void Clients::connect(const Principal& who) {
  Client& client = of(who);
  client.connected = true;
  client.maps_told.clear();
  client.cameras_told.clear();
  context_.log->info("{}: connected", client.name);
  write_verdicts(client);
  listener_.came(client);
}

void Clients::disconnect(const Principal& who) {
  Client& client = of(who);
  context_.log->info("{}: left", client.name);
  client.connected = false;
  client.left_at = context_.now();
  listener_.left(client.name);
}

void Clients::turn_away(std::set<std::string> names) {
  turned_away_ = std::move(names);
  for (auto& [name, client] : clients_) {
    if (turned_away_.contains(name))
      client.pending_offers.withdraw([](const PendingOffers::What&) { return true; });
  }
}

void Clients::note_done(const std::string& client, const std::string& action,
                        const std::string& object) const {
  context_.site.note({0, context_.site.policy()->now(), "client " + client, action, object, "done"});
}

void Clients::note_refused(Client& client, const std::string& action, const std::string& object,
                           const std::string& why) const {
  const auto said = client.refused.say(action + ", " + object + ": " + without_numbers(why),
                                       "refused: " + why, context_.now());
  if (!said) return;
  context_.site.note({0, context_.site.policy()->now(), "client " + client.name, action, object, *said});
}

void Clients::resume(const std::vector<RestoredMap>& restored, const std::vector<DeletedDecisions>& deleted) {
  std::vector<KeptDecisions> kept;
  kept.reserve(restored.size() + deleted.size());
  for (const DeletedDecisions& map : deleted)
    kept.push_back({map.header.id, map.header.epoch, map.decisions});
  for (const RestoredMap& map : restored) kept.push_back({map.header.id, map.header.epoch, map.decisions});
  for (auto& [name, resumed] : resume_clients(kept, kMaxClients)) {
    Client& client = of(client_principal(name));
    client.offer_gate.resume(resumed.session, std::move(resumed.offers));
    client.request_gate.resume(resumed.session, std::move(resumed.requests));
    if (resumed.seed) {
      client.seed_gate.resume(*resumed.seed);
    } else {
      client.seed_gate.enter_session(resumed.session);
    }
  }
}

Status Clients::try_to_tell(const Client& client, const ClientEvent& event) {
  // Its readers of maps may be there before and after those that it is told by.
  if (!client.connected && !std::holds_alternative<MapUnlisted>(event)) return {};
  Status told = context_.output.tell(client.name, with_fitting_words(event));
  if (!told && output_trouble_.due(context_.now()))
    context_.log->error("{}: {}", client.name, told.error().message);
  return told;
}

void Clients::tell_status(const wire::ServerStatus& status) {
  for (auto& [name, client] : clients_) {
    if (!client.connected) continue;
    tell(client, status);
    if (std::exchange(client.repeat_verdicts, false)) write_verdicts(client);
  }
}

std::string Clients::why_not_served(const Client& client) const {
  if (client.kicked && client.kicked == client.offer_gate.session()) return kKicked;
  if (client.lockstep_refused) return kNoLockstep;
  return context_.access().why_blocked(client.principal());
}

void Clients::write_verdicts(Client& client) {
  if (!client.connected || !client.offer_gate.session()) return;
  wire::OfferVerdict offers = client.offer_gate.verdict(client.id);
  if (const std::string why = why_not_served(client); !why.empty())
    put_notice(notice_to_process(why), &offers.recent);
  tell(client, offers);
  if (client.seed_gate.verdict().command.seq != 0) {
    tell(client, client.seed_gate.verdict());
  }
  tell(client, client.request_gate.verdict(client.id));
}

}  // namespace cairn
