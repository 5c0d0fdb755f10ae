// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "common/base/result.h"

namespace cairn {

/// What a text file says, as every reader of one wants it, of the bytes in it: UTF-8's byte order mark is
/// dropped, and where "\r" alone ends the lines they end with "\n". Error kDamaged for UTF-16, UTF-32 and
/// bytes of value 0, which no text has: it begins with `name` (the file) and says how to convert.
[[nodiscard]] Result<std::string> plain_text(std::string bytes, std::string_view name);

}  // namespace cairn
