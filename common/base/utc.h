// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {

/// "2026-12-01T12:00:00Z" (RFC 3339), to the second; of a time since the Unix epoch.
[[nodiscard]] std::string to_utc(Timestamp time);
/// Reads what to_utc() writes; also a day alone, "2026-12-01", as its beginning. Error kUsage that quotes the
/// text. Years 1970 to 2199.
[[nodiscard]] Result<Timestamp> parse_utc(std::string_view text);

}  // namespace cairn
