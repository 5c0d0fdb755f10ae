// SPDX-License-Identifier: Apache-2.0
#include "common/map/ids.h"

#include <uuid/uuid.h>

#include <algorithm>
#include <optional>

namespace cairn {
namespace {

/// Name space of client names: a random UUID, fixed for ever (changing it renames every client).
constexpr std::array<uint8_t, 16> kClientNamespace = {0x6f, 0x0d, 0x1c, 0x5e, 0x9a, 0x34, 0x4b, 0x27,
                                                      0x8d, 0x61, 0xc2, 0x7b, 0x45, 0xe8, 0x90, 0x1f};
constexpr std::string_view kHexDigits = "0123456789abcdef";

std::optional<uint8_t> hex_value(char digit) {
  const size_t value = kHexDigits.find(digit);
  if (value == std::string_view::npos) return std::nullopt;
  return static_cast<uint8_t>(value);
}

}  // namespace

std::string to_hex(const std::array<uint8_t, 16>& bytes) {
  std::string text;
  text.reserve(2 * bytes.size());
  for (const uint8_t byte : bytes) {
    text += kHexDigits[byte >> 4];
    text += kHexDigits[byte & 15];
  }
  return text;
}

Result<std::array<uint8_t, 16>> from_hex(std::string_view text) {
  const auto malformed = [text] {
    return fail(ErrorCode::kUsage,
                std::string("'").append(text).append("': not an id of 32 lower-case hex digits"));
  };
  std::array<uint8_t, 16> bytes{};
  if (text.size() != 2 * bytes.size()) return malformed();
  for (size_t i = 0; i < bytes.size(); ++i) {
    const auto high = hex_value(text[2 * i]);
    const auto low = hex_value(text[2 * i + 1]);
    if (!high || !low) return malformed();
    bytes[i] = static_cast<uint8_t>(*high << 4 | *low);
  }
  return bytes;
}

bool is_valid_name(std::string_view name) {
  const auto allowed = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-'; };
  return !name.empty() && name.size() <= kMaxNameLength && std::all_of(name.begin(), name.end(), allowed);
}

ClientId client_id_from_name(std::string_view name) {
  ClientId id;
  uuid_generate_sha1(id.bytes.data(), kClientNamespace.data(), name.data(), name.size());
  return id;
}

}  // namespace cairn
