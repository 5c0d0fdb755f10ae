// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "server/service/clients.h"
#include "server/service/map_array.h"
#include "server/service/proposal_judge.h"
#include "server/service/proposal_registry.h"
#include "server/service/service_context.h"

namespace cairn {

/// Proposals: keyframes of clients that may not add them, kept aside until an operator decides. They are
/// judged by what is published of the map, on the idle executor (in lockstep on the urgent one); the map's
/// queue hears of one when an operator accepts it. Used from the service's thread.
class Proposals {
 public:
  using Decided = std::function<void(wire::OfferOutcome outcome)>;

  Proposals(const ServiceContext& context, Clients& clients, const MapArray& maps)
      : context_(context), clients_(clients), maps_(maps), registry_(context.options.proposals) {}
  Proposals(const Proposals&) = delete;
  Proposals& operator=(const Proposals&) = delete;

  /// Takes an offer of a client as a proposal. `why`: why it is no more than that. `decided` is called when
  /// the proposal is kept aside or refused. With a store only.
  void propose(Client& client, const MapEntry& entry, wire::KeyframeOffer offer,
               const AnnouncedCamera& camera, std::string why, Decided decided);
  /// Drops proposals that nobody has decided on for long. With a store only.
  void drop_old();

  [[nodiscard]] ProposalRegistry& registry() { return registry_; }

 private:
  /// A proposal on its way, and its client.
  struct Offered {
    SessionId session;
    wire::OfferOutcome outcome;
    Decided decided;
    std::shared_ptr<const PendingOffer> pending;
  };
  [[nodiscard]] std::optional<std::pair<wire::OfferDecision, std::string>> refuse(
      const Client& client, const wire::KeyframeOffer& offer, const AnnouncedCamera& camera,
      const std::string& why);
  void on_judged(Offered offered, ProposalJudgement judged);
  /// Why a proposal that was judged well is not kept; nothing: it is.
  [[nodiscard]] std::optional<std::pair<wire::OfferDecision, std::string>> refuse_judged(
      const Offered& offered, const ProposalSummary& summary);
  void keep(Offered offered, KeptProposal kept);
  void on_kept(Offered offered, const std::string& client_name, const ProposalRegistry::Room& room,
               const Status& written);
  /// Removes proposals from registry and store. Precondition: the map is not being rolled back.
  void remove(MapId map, const std::vector<uint64_t>& numbers);

  const ServiceContext& context_;
  Clients& clients_;
  const MapArray& maps_;
  ProposalRegistry registry_;
  size_t in_work_ = 0;  ///< being looked at
};

}  // namespace cairn
