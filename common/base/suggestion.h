// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace cairn {

/// "; did you mean X?" with the word of `valid` nearest to `word` (Levenshtein distance, at most half its
/// length); empty when none is that near.
[[nodiscard]] std::string did_you_mean(std::string_view word, const std::vector<std::string>& valid);

}  // namespace cairn
