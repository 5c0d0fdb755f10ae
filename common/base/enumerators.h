// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn {

/// An enum whose numbers come from peers or files: it counts from 0 without gaps, and names its last
/// enumerator kLast as well, so that nobody else states its bound.
template <typename Enum>
concept BoundedEnum = requires {
  Enum::kLast;
};

template <BoundedEnum Enum>
inline constexpr size_t kEnumerators = static_cast<size_t>(Enum::kLast) + 1;

/// Whether a number from outside is one of the enum's.
template <BoundedEnum Enum>
[[nodiscard]] constexpr bool is_enumerator(uint64_t number) {
  return number < kEnumerators<Enum>;
}

}  // namespace cairn
