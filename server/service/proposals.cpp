// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposals.h"

#include <chrono>
#include <exception>
#include <utility>

#include "server/service/proposal_rule.h"
#include "server/service/waiting_limit.h"

namespace cairn {
namespace {

constexpr size_t kMostInWork = 8;  ///< their images are in memory meanwhile
constexpr std::chrono::milliseconds kUntilTriedAgain{200};

/// The decision for the store, by which an offer that is sent again after a restart is answered.
DecisionRecord aside_record(const std::string& client, SessionId session, const wire::OfferOutcome& outcome,
                            Timestamp time) {
  return {client,
          session,
          outcome.seq,
          CommandKind::kOffer,
          static_cast<uint8_t>(outcome.decision),
          outcome.reason,
          {},
          time,
          {},
          0};
}

}  // namespace

std::optional<std::pair<wire::OfferDecision, std::string>> Proposals::refuse(const Client& client,
                                                                             const wire::KeyframeOffer& offer,
                                                                             const AnnouncedCamera& camera,
                                                                             const std::string& why) {
  if (camera.prior)
    return std::pair(wire::OfferDecision::kNoRight,
                     "a proposal is taken of a calibrated camera only; `cairn-track calibrate` makes it one");
  std::string full = context_.store->trouble();
  if (full.empty()) full = registry_.why_full();
  if (!full.empty()) return std::pair(wire::OfferDecision::kFull, std::move(full));
  if (in_work_ >= kMostInWork)
    return std::pair(wire::OfferDecision::kBusy, "more proposals come than can be looked at");
  if (std::string why = why_too_much_waits(context_, *clients_.waiting_bytes(), offer.image.bytes.size());
      !why.empty())
    return std::pair(wire::OfferDecision::kBusy, std::move(why));
  // A replay does not go by this clock.
  std::string not_now = offer.lockstep ? "" : registry_.why_not_now(client.name, context_.now());
  if (not_now.empty()) return std::nullopt;
  if (!offer.as_proposal) return std::pair(wire::OfferDecision::kNoRight, why);
  return std::pair(wire::OfferDecision::kBusy, std::move(not_now));
}

void Proposals::propose(Client& client, const MapEntry& entry, wire::KeyframeOffer offer,
                        const AnnouncedCamera& camera, std::string why, Decided decided) {
  Offered offered{offer.command.session, {}, std::move(decided), nullptr};
  offered.outcome.seq = offer.command.seq;
  offered.outcome.map = offer.map;
  if (auto refused = refuse(client, offer, camera, why)) {
    std::tie(offered.outcome.decision, offered.outcome.reason) = std::move(*refused);
    return offered.decided(std::move(offered.outcome));
  }
  ++in_work_;
  offered.pending = client.pending_offers.add({PendingOffers::Kind::kProposal, offer.map, {}},
                                              offer.image.bytes.size(), clients_.waiting_bytes());
  // Who replays a recording waits for it.
  Executor& executor = offer.lockstep ? context_.executors.urgent : context_.executors.idle;
  executor.submit([this, name = client.name, offered = std::move(offered), snapshot = entry.snapshot,
                   camera = camera.camera, offer = std::move(offer), why = std::move(why)] {
    ProposalJudgement judged{wire::OfferDecision::kDamaged, "internal error; the server's log says more", {}};
    try {
      judged = judge_proposal(*snapshot, *camera, offer, context_.options.mapping.refind);
    } catch (const std::exception& problem) {  // memory, a library
      context_.log->error("internal error in a proposal of {}: {}", name, problem.what());
    }
    judged.kept.record.summary.client = name;
    judged.kept.record.summary.why = why;
    context_.post([this, offered, judged = std::move(judged)]() mutable {
      on_judged(std::move(offered), std::move(judged));
    });
  });
}

std::optional<std::pair<wire::OfferDecision, std::string>> Proposals::refuse_judged(
    const Offered& offered, const ProposalSummary& summary) {
  const MapId map = offered.outcome.map;
  const auto entry = maps_.all().find(map);
  const Client* client = clients_.find(summary.client);
  if (entry == maps_.all().end() || entry->second.snapshot == nullptr)
    return std::pair(wire::OfferDecision::kUnknownMap, "this server does not know the map");
  if (entry->second.rolling_back) return std::pair(wire::OfferDecision::kBusy, kRollingBack);
  if (offered.pending->is_withdrawn() || client == nullptr ||
      !takes_proposals(context_, *client, map, entry->second))
    return std::pair(wire::OfferDecision::kNoRight, kNoProposals);
  const ProposalSummary* other = registry_.find_alike(map, summary);
  if (other == nullptr) return std::nullopt;
  return std::pair(wire::OfferDecision::kTooClose,
                   "proposal " + proposal_id(map, other->number) + " shows the same already");
}

void Proposals::on_judged(Offered offered, ProposalJudgement judged) {
  --in_work_;
  wire::OfferOutcome& outcome = offered.outcome;
  outcome.decision = judged.decision;
  outcome.reason = judged.reason;
  if (outcome.decision == wire::OfferDecision::kKeptAside) {
    if (auto refused = refuse_judged(offered, judged.kept.record.summary))
      std::tie(outcome.decision, outcome.reason) = std::move(*refused);
  }
  if (outcome.decision != wire::OfferDecision::kKeptAside) return offered.decided(std::move(outcome));
  keep(std::move(offered), std::move(judged.kept));
}

/// Keeps a proposal with the decision on its offer: sent again after a restart, the offer is answered and not
/// kept twice.
void Proposals::keep(Offered offered, KeptProposal kept) {
  wire::OfferOutcome& outcome = offered.outcome;
  ProposalSummary& summary = kept.record.summary;
  summary.received = context_.wall();
  outcome.reason = "kept aside as a proposal: " + summary.why;
  const ProposalRegistry::Room room = registry_.add(outcome.map, summary);
  summary.number = room.number;
  const std::string name = summary.client;
  MapUpdate update;
  update.decisions.push_back(aside_record(name, offered.session, outcome, summary.received));
  update.proposals.push_back(std::move(kept));
  const MapId map = outcome.map;
  context_.store->write(map, std::move(update),
                        [this, name, offered = std::move(offered), room](const Status& written) {
                          context_.post([this, name, offered, room, written]() mutable {
                            on_kept(std::move(offered), name, room, written);
                          });
                        });
}

/// What goes for it goes when it stays, and what is withdrawn is taken out of the store again: neither while
/// the map is being rolled back.
void Proposals::on_kept(Offered offered, const std::string& client_name, const ProposalRegistry::Room& room,
                        const Status& written) {
  wire::OfferOutcome& outcome = offered.outcome;
  const MapId map = outcome.map;
  const auto entry = maps_.all().find(map);
  if (written && entry != maps_.all().end() && entry->second.rolling_back) {
    const auto again = [this, offered = std::move(offered), client_name, room, written] {
      context_.post(
          [this, offered, client_name, room, written] { on_kept(offered, client_name, room, written); });
    };
    return context_.store->later(again, kUntilTriedAgain);
  }
  if (!written) {
    registry_.take_back(map, room);
    outcome.decision = wire::OfferDecision::kFull;
    outcome.reason = written.error().message;
  } else if (offered.pending->is_withdrawn()) {
    registry_.take_back(map, room);
    outcome.decision = wire::OfferDecision::kNoRight;
    outcome.reason = kNoProposals;
    MapUpdate update;
    update.removed_proposals.push_back(room.number);
    update.decisions.push_back(aside_record(client_name, offered.session, outcome, context_.wall()));
    context_.store->write(map, std::move(update), {});
  } else {
    context_.log->info("{}: proposal {} kept aside", client_name, proposal_id(map, room.number));
    std::vector<uint64_t> gone;
    for (const ProposalSummary& each : room.gone) gone.push_back(each.number);
    if (!gone.empty()) remove(map, gone);
  }
  offered.decided(std::move(outcome));
}

void Proposals::drop_old() {
  for (auto& [map, numbers] : registry_.too_old(context_.wall())) {
    const auto entry = maps_.all().find(map);
    if (entry == maps_.all().end() || entry->second.rolling_back) continue;  // later
    for (const uint64_t number : numbers)
      context_.log->info("proposal {} is dropped: nobody has decided on it for long",
                         proposal_id(map, number));
    remove(map, numbers);
  }
}

void Proposals::remove(MapId map, const std::vector<uint64_t>& numbers) {
  for (const uint64_t number : numbers) registry_.remove(map, number);
  MapUpdate update;
  update.removed_proposals = numbers;
  context_.store->write(map, std::move(update), {});
}

}  // namespace cairn
