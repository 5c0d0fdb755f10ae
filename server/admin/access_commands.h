// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.h"
#include "server/admin/admin_client.h"

namespace cairn {

/// What `cairnctl rights`, `clients`, `audit` and `map MAP freeze` ask for: nothing, unless their words were
/// there. `as_json`: answers are printed for machines.
using AccessAction = std::function<Status(AdminClient* client, bool as_json)>;

/// The words of `cairnctl rights`, `clients` and `audit`; `action` is what they ask for.
void describe_access(CLI::App* app, AccessAction* action);

/// The words `freeze` and `unfreeze` below `map MAP`; `map`: its name, once the line has been read.
void describe_freeze(CLI::App* below, const std::string* map, AccessAction* action);

}  // namespace cairn
