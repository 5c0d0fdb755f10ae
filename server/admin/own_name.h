// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/result.h"

namespace cairn {

/// "USER-PROCESS", a name that no other process of this machine has: an operator's, or a commander's.
[[nodiscard]] std::string own_name();

/// By which an operator goes: as its keys say in a secured site, own_name() in an open one (`security` is
/// empty). Errors: those of wire::secured_name().
[[nodiscard]] Result<std::string> operator_name(const std::string& security);

}  // namespace cairn
