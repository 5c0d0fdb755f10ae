// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "common/base/repeats.h"
#include "server/service/admin_request.h"
#include "server/service/map_news.h"
#include "server/service/operator_answer.h"
#include "server/service/rights_verbs.h"

namespace cairn {

/// What a client may no longer do or read is taken from it at once, and what it may read now is offered.
void enforce_rights(const ServiceContext& context, Clients& clients, MapNews& news);

/// What operators ask about who may do what and what was done, and how it comes into force. Used from the
/// service's thread.
class SiteAdministration {
 public:
  SiteAdministration(const ServiceContext& context, MapArray& maps, Clients& clients, MapNews& news)
      : context_(context), maps_(maps), clients_(clients), news_(news) {}
  SiteAdministration(const SiteAdministration&) = delete;
  SiteAdministration& operator=(const SiteAdministration&) = delete;

  void take(const std::string& operator_name, const asked::ChangeRights& ask, const AdminAnswer& answer);
  void take(const asked::Rights& ask, const AdminAnswer& answer);
  void take(const asked::ExplainRights& ask, const AdminAnswer& answer);
  void take(const asked::Audit& ask, const AdminAnswer& answer);
  /// The answer is told, and what the operator did, or tried to, is written down.
  [[nodiscard]] AdminAnswer audited(const std::string& operator_name, const AskedOfServer& asks,
                                    const AdminAnswer& tell);

 private:
  [[nodiscard]] std::optional<NamedMap> named_map(const std::string& name_or_id);
  [[nodiscard]] KnownClients known_clients() const;

  const ServiceContext& context_;
  MapArray& maps_;
  Clients& clients_;
  MapNews& news_;
  Repeats refused_{};  ///< of operators, for the audit log
};

}  // namespace cairn
