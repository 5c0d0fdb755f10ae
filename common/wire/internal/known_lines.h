// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace cairn::wire::internal {

/// What a line of the middleware's log means, where that is known.
struct KnownLine {
  std::string words;         ///< for a person
  bool is_harmless = false;  ///< nobody has to know or to do anything: for who looks for a fault
};
/// What the line means. Nothing: the line speaks for itself, or nobody has met it yet. Pure.
[[nodiscard]] std::optional<KnownLine> known_line(std::string_view line);

}  // namespace cairn::wire::internal
