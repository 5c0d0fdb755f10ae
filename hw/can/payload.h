// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace cairn {

/// A number of the payload, at byte `offset`, in that byte order. The payload reaches so far.
template <typename T>
[[nodiscard]] T get_number(std::span<const uint8_t> payload, size_t offset, std::endian order) {
  std::array<uint8_t, sizeof(T)> bytes{};
  std::copy_n(payload.begin() + static_cast<std::ptrdiff_t>(offset), sizeof(T), bytes.begin());
  if (order != std::endian::native) std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<T>(bytes);
}

template <typename T>
void put_number(T value, std::span<uint8_t> payload, size_t offset, std::endian order) {
  auto bytes = std::bit_cast<std::array<uint8_t, sizeof(T)>>(value);
  if (order != std::endian::native) std::reverse(bytes.begin(), bytes.end());
  std::copy_n(bytes.begin(), sizeof(T), payload.begin() + static_cast<std::ptrdiff_t>(offset));
}

}  // namespace cairn
