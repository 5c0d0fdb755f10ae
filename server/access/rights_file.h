// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "common/base/result.h"
#include "server/access/rights.h"

namespace cairn {

/// The rights as JSON text, one line for each rule: what the store keeps and an operator may read. The keys
/// are described in FORMAT.md.
[[nodiscard]] std::string to_text(const Rights& rights);

/// Its inverse. Error kDamaged, with the rule that is wrong and why: no JSON, an unknown key, a value that
/// cannot be, a time in no calendar, more than `kMostRules` rules. Nothing is taken in part.
[[nodiscard]] Result<Rights> read_rights(std::string_view text);

/// Most rules of each kind in a file; more is no list that a person keeps.
inline constexpr size_t kMostRules = 100'000;

}  // namespace cairn
