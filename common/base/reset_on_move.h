// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>

namespace cairn {

/// A member that says how much another member holds: where that has been moved away, this is its default
/// again, so that what is moved from is empty instead of claiming what it has no more.
template <typename T>
class ResetOnMove {
 public:
  constexpr ResetOnMove(T value = T{}) : value_(std::move(value)) {}  // NOLINT: it stands for its value
  ResetOnMove(const ResetOnMove&) = default;
  ResetOnMove& operator=(const ResetOnMove&) = default;
  ResetOnMove(ResetOnMove&& other) noexcept : value_(std::exchange(other.value_, T{})) {}
  ResetOnMove& operator=(ResetOnMove&& other) noexcept {
    // Moved to itself it keeps its value, though the member of which it tells may be empty then.
    T taken = std::exchange(other.value_, T{});
    value_ = std::move(taken);
    return *this;
  }
  ~ResetOnMove() = default;

  constexpr operator const T&() const { return value_; }  // NOLINT: likewise

 private:
  T value_;
};

}  // namespace cairn
