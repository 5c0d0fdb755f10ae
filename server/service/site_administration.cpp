// SPDX-License-Identifier: Apache-2.0
#include "server/service/site_administration.h"

#include <algorithm>
#include <utility>

#include "server/service/rights_verbs.h"

namespace cairn {

void enforce_rights(const ServiceContext& context, Clients& clients, MapNews& news) {
  for (auto& known : clients.all()) {
    Client& client = known.second;
    client.pending_offers.withdraw([&](const PendingOffers::What& what) {
      if (what.kind == PendingOffers::Kind::kProposal)
        return !context.access().may_propose(client.principal(), what.map);
      const bool is_seed = what.kind == PendingOffers::Kind::kSeed;
      const Ruling now = is_seed ? context.access().on_creating(client.principal())
                                 : context.access().in_map(client.principal(), what.map);
      return now.right < (is_seed ? Right::kWrite : Right::kAdd) || now.extent != what.extent;
    });
    news.tell_by_rights(client);
    clients.write_verdicts(client);  // whether it is kept out altogether
  }
}

namespace {

/// Bounds of a map: of its points, but for those farthest out, and of its keyframes' cameras.
Box bounds_of(const MapEntry& entry) {
  Box bounds{entry.statistics.bounds_min.cast<double>(), entry.statistics.bounds_max.cast<double>()};
  if (entry.snapshot == nullptr) return bounds;
  for (const auto& block : entry.snapshot->keyframe_blocks) {
    for (size_t slot = 0; slot < block->keyframes.size(); ++slot) {
      if ((block->live >> slot & 1U) == 0) continue;
      const Eigen::Vector3d center = block->keyframes[slot].camera_from_map.center();
      bounds = {bounds.min.cwiseMin(center), bounds.max.cwiseMax(center)};
    }
  }
  return bounds;
}

}  // namespace

std::optional<NamedMap> SiteAdministration::named_map(const std::string& name_or_id) {
  const auto [id, entry] = find_called(maps_, name_or_id);
  if (entry == nullptr) return std::nullopt;
  return NamedMap{id, entry->name, bounds_of(*entry)};
}

KnownClients SiteAdministration::known_clients() const {
  const std::optional<GroupsOfClients>& with_keys = context_.site.clients_with_keys();
  KnownClients known{{}, with_keys.has_value(), clients_.turned_away()};
  for (const auto& [name, client] : clients_.all()) known.names.insert(name);
  for (const auto& [name, groups] : with_keys.value_or(GroupsOfClients{})) known.names.insert(name);
  return known;
}

void SiteAdministration::take(const std::string& operator_name, const asked::ChangeRights& ask,
                              const AdminAnswer& answer) {
  const FindMap find = [this](const std::string& name) { return named_map(name); };
  SiteAccess& site = context_.site;
  auto change = change_rights(site.rights(), ask, operator_name, find, site.policy()->now());
  if (!change) return answer(refusal(change.error()));
  told::Done done{change->entry.action + ": " + change->entry.object,
                  note_on_names(change->rights, ask, known_clients())};
  site.put(std::move(*change), [this, answer, done = std::move(done)](const Status& kept) {
    if (!kept) return answer(refusal(kept.error()));
    enforce_rights(context_, clients_, news_);
    answer(done);
  });
}

void SiteAdministration::take(const asked::Rights&, const AdminAnswer& answer) {
  const SiteAccess& site = context_.site;
  told::Rights told{site.rights().table(), {}, site.policy()->now(), site.secured_since(), site.is_kept()};
  for (const auto& [map, entry] : maps_.all()) told.names[map] = entry.name;
  answer(std::move(told));
}

void SiteAdministration::take(const asked::ExplainRights& ask, const AdminAnswer& answer) {
  const FindMap find = [this](const std::string& name) { return named_map(name); };
  const SiteAccess& site = context_.site;
  const auto explained = explain_rights(site.rights(), ask, find, known_clients(), site.policy()->now());
  explained ? answer(*explained) : answer(refusal(explained.error()));
}

void SiteAdministration::take(const asked::Audit& ask, const AdminAnswer& answer) {
  context_.site.find(ask.query, [answer](const Result<std::vector<AuditEntry>>& found) {
    found ? answer(told::Audit{*found}) : answer(refusal(found.error()));
  });
}

AdminAnswer SiteAdministration::audited(const std::string& operator_name, const AskedOfServer& asks,
                                        const AdminAnswer& tell) {
  AuditEntry entry{0, {}, "operator " + operator_name, asks.verb, asks.object, {}};
  std::ranges::replace(entry.action, '-', ' ');
  const bool is_kept_with_rights = std::holds_alternative<asked::ChangeRights>(asks.what);
  return [this, entry, tell, is_kept_with_rights](OperatorAnswer told) mutable {
    const bool is_done = told.has_value();
    // Of a label that is removed the request has no text.
    const auto* label = is_done ? std::get_if<told::LabelSeen>(&*told) : nullptr;
    if (label != nullptr && entry.object.find(", text ") == std::string::npos)
      entry.object += ", text " + label->label.text;
    const std::string said = is_done ? "done" : words_of(told.error());
    const auto outcome = is_done ? std::optional(said)
                                 : refused_.say(entry.who + ", " + entry.action + ", " + entry.object + ": " +
                                                    without_numbers(said),
                                                said, context_.now());
    if (outcome && !(is_done && is_kept_with_rights)) {
      entry.time = context_.site.policy()->now();
      entry.outcome = *outcome;
      context_.site.note(entry);
    }
    tell(std::move(told));
  };
}

}  // namespace cairn
