// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace cairn {

/// "USER-PROCESS", a name that no other process of this machine has: an operator's, or a commander's.
[[nodiscard]] std::string own_name();

}  // namespace cairn
