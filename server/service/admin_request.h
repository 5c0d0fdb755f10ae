// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

/// What operators ask, as it comes from the wire (idl/README.md, AdminRequest): any text. Pure.
namespace cairn {

/// Not an object (`null`) where the text is none, or is nested without end.
[[nodiscard]] nlohmann::json parse_admin_request(const std::string& text);

namespace asked {

/// A member that must be a text; empty where there is none, or something else.
[[nodiscard]] std::string text_of(const nlohmann::json& request, const char* key);
/// A member that must be a number from 0 on; 0 where there is none, or something else.
[[nodiscard]] uint64_t number_of(const nlohmann::json& request, const char* key);
/// A member that must be a truth; false where there is none, or something else.
[[nodiscard]] bool is_set(const nlohmann::json& request, const char* key);

}  // namespace asked

}  // namespace cairn
