// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "common/base/result.h"
#include "server/admin/rig_client.h"

namespace cairn {

/// The action of `cairnctl rig`, on a rig and not on a server; empty, unless its words were there. `as_json`:
/// states are printed for machines.
using RigAction = std::function<Status(const RigClientOptions& network, bool as_json)>;

/// The words of `cairnctl rig`; `action` is what they ask for.
void describe_rig(CLI::App* app, RigAction* action);

}  // namespace cairn
