// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "server/service/admin_request.h"
#include "server/service/capacity.h"
#include "server/service/operator_answer.h"
#include "server/service/proposal_registry.h"
#include "server/service/served_maps.h"

namespace cairn {

/// What operators decide of proposals: one that is accepted goes to the map maker, which judges it as any
/// other offer, by the map as it is now. Used from the service's thread.
class ProposalAdministration {
 public:
  ProposalAdministration(const ServiceContext& context, ServedMaps& maps, const Capacity& capacity,
                         ProposalRegistry& registry)
      : context_(context), maps_(maps), capacity_(capacity), registry_(registry) {}
  ProposalAdministration(const ProposalAdministration&) = delete;
  ProposalAdministration& operator=(const ProposalAdministration&) = delete;

  void take(const asked::Proposals& ask, const AdminAnswer& answer);
  void take(const asked::ShowProposal& ask, const AdminAnswer& answer);
  void take(const asked::ProposalImage& ask, const AdminAnswer& answer);
  void take(const asked::AcceptProposal& ask, const AdminAnswer& answer);
  void take(const asked::DropProposal& ask, const AdminAnswer& answer);

 private:
  struct Named {
    MapId map;
    uint64_t number = 0;
  };
  /// The proposal of that id; nothing: it has been answered that there is none.
  [[nodiscard]] std::optional<Named> find(const std::string& id, const AdminAnswer& answer) const;
  /// If it can be read, `use` is called on the service's thread; if not, that is the answer.
  void read(const Named& which, const AdminAnswer& answer, std::function<void(KeptProposal kept)> use);
  void drop(const Named& which, const AdminAnswer& answer);
  [[nodiscard]] std::string why_not_accepted(MapId map, const MapEntry& entry) const;
  void offer(const Named& which, KeptProposal kept, const AdminAnswer& answer);
  /// `is_final`: what was refused as stale would be so again.
  void on_decided(const Named& which, const std::string& client, const OfferJudgement& judgement,
                  bool is_final, const AdminAnswer& answer);

  const ServiceContext& context_;
  ServedMaps& maps_;
  const Capacity& capacity_;
  ProposalRegistry& registry_;
};

}  // namespace cairn
