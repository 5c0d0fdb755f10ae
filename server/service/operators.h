// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/rate_limit.h"
#include "server/access/principal.h"
#include "server/service/admin_gate.h"
#include "server/service/archives.h"
#include "server/service/label_administration.h"
#include "server/service/map_administration.h"
#include "server/service/map_versions.h"
#include "server/service/overview.h"
#include "server/service/proposal_administration.h"
#include "server/service/rig_list.h"
#include "server/service/site_administration.h"
#include "server/service/store_administration.h"

namespace cairn {

/// What operators ask for (idl/README.md, AdminRequest): each request is carried out once, if its operator
/// may, and answered whatever happens; what changes something is on record. Used from the service's thread.
class Operators {
 public:
  /// The components that carry them out.
  struct Desks {
    Overview& overview;
    Sessions& sessions;
    RigList& rigs;
    SiteAdministration& site;
    MapAdministration& maps;
    Archives& archives;
    MapVersions& versions;
    LabelAdministration& labels;
    ProposalAdministration& proposals;
    StoreAdministration& store;
  };
  Operators(const ServiceContext& context, MapArray& maps, Desks desks)
      : context_(context), maps_(maps), desks_(desks) {}
  Operators(const Operators&) = delete;
  Operators& operator=(const Operators&) = delete;

  void take(const Principal& who, const wire::AdminRequest& message);

 private:
  class Ticket;
  void refuse_for_now(const std::string& operator_name, wire::CommandId command, const std::string& why);
  /// Writes the last answer to this operator once more.
  void repeat_answer(const std::string& operator_name, wire::CommandId command);
  void carry_out(const Principal& who, const wire::AdminRequest& message, const AdminAnswer& tell);
  void pass_on(const Principal& who, const AskedOfServer& asks, const std::vector<uint8_t>& data,
               const AdminAnswer& answer);
  void pass_on(const Principal& who, const std::string& verb, const asked::OfMap& ask,
               const AdminAnswer& answer);
  void kick(const std::string& client, const AdminAnswer& answer);

  const ServiceContext& context_;
  MapArray& maps_;
  const Desks desks_;
  AdminGate gate_;
  RateLimit output_trouble_;
};

}  // namespace cairn
