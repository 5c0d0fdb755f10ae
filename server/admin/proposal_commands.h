// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>

#include "server/admin/asking.h"

namespace cairn {

/// The word `proposals` and those below it.
void describe_proposals(CLI::App* app, AccessAction* action);

}  // namespace cairn
