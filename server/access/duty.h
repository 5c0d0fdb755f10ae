// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace cairn {

/// What an operator may do at the server; each includes those before it.
enum class Duty : uint8_t {
  kWatch,       ///< sees everything, changes nothing
  kCurate,      ///< looks after maps and labels
  kAdminister,  ///< says who may do what
};

inline constexpr std::array<std::string_view, 3> kDuties{"watch", "curate", "administer"};

/// The word of the command line and of the register of the keys.
[[nodiscard]] constexpr std::string_view to_string(Duty duty) {
  return kDuties.at(static_cast<size_t>(duty));
}

}  // namespace cairn
