// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "common/base/result.h"

namespace cairn {

/// The action of `cairnctl keys`, on a folder and not on a server; empty, unless its words were there.
using KeysAction = std::function<Status(bool as_json)>;

/// The words of `cairnctl keys`; `action` is what they ask for.
void describe_keys(CLI::App* app, KeysAction* action);

}  // namespace cairn
