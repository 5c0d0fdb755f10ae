// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>

#include "server/admin/asking.h"

namespace cairn {

/// The words of `cairnctl top` and `wearers`.
void describe_watch(CLI::App* app, AccessAction* action);

}  // namespace cairn
