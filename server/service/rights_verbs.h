// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "common/base/result.h"
#include "common/map/extent.h"
#include "server/access/rights.h"
#include "server/store/site_file.h"

/// What operators ask about rights, as JSON (idl/README.md, AdminRequest): pure, on a copy of the rights. Who
/// calls it keeps the outcome and puts it into force.
namespace cairn {

/// What there is to know of a map that a request names.
struct NamedMap {
  MapId id;
  std::string name;
  Box bounds;  ///< of its points, map frame
};
/// By name or id; nothing: there is none.
using FindMap = std::function<std::optional<NamedMap>(const std::string& name_or_id)>;

struct RightsChange {
  Rights rights;          ///< as they are to be
  AuditEntry entry;       ///< who changed them, and how
  nlohmann::json answer;  ///< once they are kept
};

/// Whether this is one of these requests: the verbs "rights-..." and "map-freeze", "map-unfreeze",
/// "client-block", "client-unblock", "proposals-welcome".
[[nodiscard]] bool changes_rights(const std::string& verb);

/// rights-grant (to, map, right, within, until), rights-revoke (to, map), rights-default (right, create),
/// rights-create (to, may), rights-group (group, members), map-freeze (map, why), map-unfreeze (map),
/// client-block (client, why), client-unblock (client), proposals-welcome (map, welcome). `within`: {"box":
/// [[x, y, z], [x, y, z]]},
/// {"center": [x, y, z], "radius": r}, or {"margin": m} around the map's present bounds. Errors kUsage,
/// kNotFound: what is wrong with it.
[[nodiscard]] Result<RightsChange> change_rights(const Rights& rights, const nlohmann::json& request,
                                                 const std::string& operator_name, const FindMap& find,
                                                 Timestamp now);

/// rights-show: all rules, for a person and for machines. `name_of`: of a map; empty: it is not served.
[[nodiscard]] nlohmann::json describe_rights(const Rights& rights,
                                             const std::function<std::string(const MapId&)>& name_of,
                                             Timestamp now);

/// rights-explain (client, map): what it may do, and the rules that say so.
[[nodiscard]] Result<nlohmann::json> explain_rights(const Rights& rights, const nlohmann::json& request,
                                                    const FindMap& find, Timestamp now);

/// audit (who, action, object, from, until, before, limit).
[[nodiscard]] Result<AuditQuery> audit_query_of(const nlohmann::json& request);
[[nodiscard]] nlohmann::json describe(const AuditEntry& entry);

}  // namespace cairn
