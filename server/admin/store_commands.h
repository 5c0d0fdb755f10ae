// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "server/admin/asking.h"

namespace cairn {

/// The action of a command that asks no server: on a store in a folder here, or on a backup.
using LocalAction = std::function<Status(bool as_json)>;

/// The words of `cairnctl backup`, `restore` and `verify`; one of both is what they ask for.
void describe_store(CLI::App* app, AccessAction* action, LocalAction* local);

}  // namespace cairn
