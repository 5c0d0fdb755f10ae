// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "server/admin/asking.h"

namespace cairn {

/// The words `tag`, `tags`, `untag`, `rollback`, `copy`, `contributors` and `drop-contributor` below `map
/// MAP`; `map`: its name, once the line has been read.
void describe_versions(CLI::App* below, const std::string* map, AccessAction* action);

/// The words `drop-contributor` below `maps`.
void describe_drop_from_all(CLI::App* maps, AccessAction* action);

}  // namespace cairn
