// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/base/result.h"
#include "common/map/extent.h"
#include "server/access/rights.h"
#include "server/service/admin_request.h"
#include "server/service/operator_answer.h"
#include "server/store/site_file.h"

/// What operators ask about rights: pure, on a copy of the rights. Who calls it keeps the outcome and puts it
/// into force.
namespace cairn {

/// A map that a request names.
struct NamedMap {
  MapId id;
  std::string name;
  Box bounds;  ///< of its points and its keyframes' cameras, map frame
};
/// Finds a map by name or id; nothing: there is none.
using FindMap = std::function<std::optional<NamedMap>(const std::string& name_or_id)>;

/// Which clients there are, so that a name that was mistyped is noticed. Rights for who comes later are
/// possible.
struct KnownClients {
  std::set<std::string> names;         ///< that have keys, or have connected since the server started
  bool have_keys = false;              ///< in a secured site
  std::set<std::string> revoked = {};  ///< whose keys the server takes no more
};

struct RightsChange {
  Rights rights;     ///< as they are to be
  AuditEntry entry;  ///< who changed them, and how
};

/// The rights after a change that an operator asks for. Errors kUsage, kNotFound, with what is wrong with it.
[[nodiscard]] Result<RightsChange> change_rights(const Rights& rights, const asked::ChangeRights& ask,
                                                 const std::string& operator_name, const FindMap& find,
                                                 Timestamp now);

/// A note for a person on clients and groups of a request that are not known, or whose keys are revoked;
/// empty: there is nothing to note. `rights`: as the request has made them.
[[nodiscard]] std::string note_on_names(const Rights& rights, const asked::ChangeRights& ask,
                                        const KnownClients& known);

/// What a client may do, and the rules that say so. Errors kUsage, kNotFound.
[[nodiscard]] Result<told::ExplainedRights> explain_rights(const Rights& rights,
                                                           const asked::ExplainRights& ask,
                                                           const FindMap& find, const KnownClients& known,
                                                           Timestamp now);

}  // namespace cairn
