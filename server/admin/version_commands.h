// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "server/admin/asking.h"

namespace cairn {

/// The words `tag`, `tags`, `untag`, `rollback` and `copy` below `map MAP`; `map`: its name, once the line
/// has been read.
void describe_versions(CLI::App* below, const std::string* map, AccessAction* action);

}  // namespace cairn
