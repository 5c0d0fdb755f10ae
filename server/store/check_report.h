// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "server/store/store_check.h"

namespace cairn {

/// What was found in a file, as `verify-part` answers it and `cairnctl verify --json` prints it. Of very many
/// faults, the first and how many more there are.
[[nodiscard]] nlohmann::json describe(const FileCheck& check);

}  // namespace cairn
