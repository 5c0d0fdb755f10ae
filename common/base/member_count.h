// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <utility>

namespace cairn {
namespace internal {

/// Stands for a value of whatever type a member has; never evaluated.
struct AnyValue {
  template <typename T>
  constexpr operator T() const;  // NOLINT: the conversion is what it is for
};

template <typename Aggregate, size_t... kIndex>
[[nodiscard]] consteval bool takes_values(std::index_sequence<kIndex...> /*values*/) {
  return requires {
    Aggregate{((void)kIndex, AnyValue())...};
  };
}

}  // namespace internal

/// How many members an aggregate has: as many values as its braces take. A member that is an array of C
/// counts for each of its elements; a std::array is one.
template <typename Aggregate, size_t kCount = 0>
[[nodiscard]] consteval size_t member_count() {
  if constexpr (internal::takes_values<Aggregate>(std::make_index_sequence<kCount + 1>())) {
    return member_count<Aggregate, kCount + 1>();
  } else {
    return kCount;
  }
}

}  // namespace cairn
