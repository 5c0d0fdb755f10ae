// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "server/service/admin_request.h"

/// What operators ask about rights and of the audit log, out of JSON (idl/README.md, AdminRequest). Errors
/// kUsage: what is missing, or is not what it must be. Pure.
namespace cairn {

/// Whether this is one of these requests: the verbs "rights-..." that change something, "map-freeze",
/// "map-unfreeze", "map-extent", "client-block", "client-unblock", "proposals-welcome".
[[nodiscard]] bool changes_rights(const std::string& verb);

/// rights-grant (to, map, right, within, until), rights-revoke (to, map), rights-default (right, create),
/// rights-create (to, may), rights-group (group, members), map-freeze (map, why), map-unfreeze (map),
/// map-extent (to, map, within),
/// client-block (client, why), client-unblock (client), proposals-welcome (map, welcome). `within`: {"box":
/// [[x, y, z], [x, y, z]]}, {"center": [x, y, z], "radius": r}, or {"margin": m}. `verb`: one of these.
[[nodiscard]] Result<asked::ChangeRights> read_change_rights(const std::string& verb,
                                                             const nlohmann::json& request);
/// rights-explain (client, map).
[[nodiscard]] Result<asked::ExplainRights> read_explain_rights(const nlohmann::json& request);
/// audit (who, action, object, from, until, before, limit).
[[nodiscard]] Result<asked::Audit> read_audit(const nlohmann::json& request);

}  // namespace cairn
