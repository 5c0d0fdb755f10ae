// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
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

/// What there is to know of a map that a request names.
struct NamedMap {
  MapId id;
  std::string name;
  Box bounds;  ///< of its points and its keyframes' cameras, map frame
};
/// By name or id; nothing: there is none.
using FindMap = std::function<std::optional<NamedMap>(const std::string& name_or_id)>;

struct RightsChange {
  Rights rights;     ///< as they are to be
  AuditEntry entry;  ///< who changed them, and how
};

/// Errors kUsage, kNotFound: what is wrong with it.
[[nodiscard]] Result<RightsChange> change_rights(const Rights& rights, const asked::ChangeRights& ask,
                                                 const std::string& operator_name, const FindMap& find,
                                                 Timestamp now);

/// What a client may do, and the rules that say so. Errors kUsage, kNotFound.
[[nodiscard]] Result<told::ExplainedRights> explain_rights(const Rights& rights,
                                                           const asked::ExplainRights& ask,
                                                           const FindMap& find, Timestamp now);

}  // namespace cairn
