// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.h"
#include "server/admin/asking.h"

namespace cairn {

/// The words of `cairnctl rights`, `clients` and `audit`; `action` is what they ask for.
void describe_access(CLI::App* app, AccessAction* action);

/// The words `freeze` and `unfreeze` below `map MAP`; `map`: its name, once the line has been read.
void describe_freeze(CLI::App* below, const std::string* map, AccessAction* action);

/// The words `extent` below it.
void describe_extent(CLI::App* below, const std::string* map, AccessAction* action);

}  // namespace cairn
