// SPDX-License-Identifier: Apache-2.0
#include "server/service/site_administration.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/utc.h"
#include "server/service/rights_verbs.h"

namespace cairn {

using nlohmann::json;

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
  }
}

std::optional<NamedMap> SiteAdministration::named_map(const std::string& name_or_id) {
  const auto [id, entry] = maps_.find_called(name_or_id);
  if (entry == nullptr) return std::nullopt;
  const MapStatistics& now = entry->statistics;
  return NamedMap{id, entry->name, {now.bounds_min.cast<double>(), now.bounds_max.cast<double>()}};
}

void SiteAdministration::take(const std::string& operator_name, const asked::ChangeRights& ask,
                              const AdminAnswer& answer) {
  const FindMap find = [this](const std::string& name) { return named_map(name); };
  SiteAccess& site = context_.site;
  auto change = change_rights(site.rights(), ask.request, operator_name, find, site.policy()->now());
  if (!change) return answer(refusal(change.error()));
  site.put(std::move(*change), [this, answer, done = change->answer](const Status& kept) {
    if (!kept) return answer(refusal(kept.error()));
    enforce_rights(context_, clients_, news_);
    answer(success(done));
  });
}

void SiteAdministration::take(const asked::Rights&, const AdminAnswer& answer) {
  const SiteAccess& site = context_.site;
  const auto name_of = [this](const MapId& map) {
    const MapEntry* entry = maps_.array().find(map);
    return entry == nullptr ? std::string() : entry->name;
  };
  json content = describe_rights(site.rights(), name_of, site.policy()->now());
  if (const auto& since = site.secured_since()) {
    content["secured"] = to_utc(*since);
    content["note"] =
        "a secured site since " + to_utc(*since) + "; what everyone had been allowed before is withdrawn";
  }
  if (!site.is_kept()) content["note"] = "this server has no --store: its rights are gone when it ends";
  answer(success(content));
}

void SiteAdministration::take(const asked::ExplainRights& ask, const AdminAnswer& answer) {
  const FindMap find = [this](const std::string& name) { return named_map(name); };
  const SiteAccess& site = context_.site;
  const auto explained = explain_rights(site.rights(), ask.request, find, site.policy()->now());
  answer(explained ? success(*explained) : refusal(explained.error()));
}

void SiteAdministration::take(const asked::Audit& ask, const AdminAnswer& answer) {
  const auto query = audit_query_of(ask.request);
  if (!query) return answer(refusal(query.error()));
  context_.site.find(*query, [answer](const Result<std::vector<AuditEntry>>& found) {
    if (!found) return answer(refusal(found.error()));
    ReplyPage page{"entries"};
    for (const AuditEntry& entry : *found) {
      if (!page.add("entries", describe(entry))) break;  // the next page begins before the last of these
    }
    answer(success(page.content()));
  });
}

AdminAnswer SiteAdministration::audited(const std::string& operator_name, const AskedOfServer& asks,
                                        const AdminAnswer& tell) {
  AuditEntry entry{0, {}, "operator " + operator_name, asks.verb, asks.object, {}};
  std::ranges::replace(entry.action, '-', ' ');
  const bool is_kept_with_rights = std::holds_alternative<asked::ChangeRights>(asks.what);
  return [this, entry, tell, is_kept_with_rights](wire::AdminReply reply) mutable {
    const bool is_done = reply.result == 0;
    if (!is_done || !is_kept_with_rights) {
      entry.time = context_.site.policy()->now();
      entry.outcome = is_done ? "done" : reply.text;
      context_.site.note(entry);
    }
    tell(std::move(reply));
  };
}

}  // namespace cairn
