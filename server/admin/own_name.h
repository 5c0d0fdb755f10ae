// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/result.h"

namespace cairn {

/// Who runs this program, as the operating system knows them: who has become another by sudo goes by the name
/// that they had before. [a-z0-9-]{1,20}
[[nodiscard]] std::string person_name();

/// "USER-PROCESS", a name that no other process of this machine has: an operator's, or a commander's.
[[nodiscard]] std::string own_name();

/// By which an operator goes: as its keys say in a secured site, own_name() in an open one (`security` is
/// empty). Errors: those of wire::secured_name().
[[nodiscard]] Result<std::string> operator_name(const std::string& security);

}  // namespace cairn
