// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

/// JSON as text. nlohmann's dump() throws by default where a text is no UTF-8, also when the work that it
/// tells of is done; these never do: each such byte becomes U+FFFD.
namespace cairn {

/// The text of a JSON value for people and files. `indent` below 0: on one line.
template <typename Json>
[[nodiscard]] std::string json_text(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

/// The text of a JSON value for the wire: on one line, ASCII with escapes for the rest, so that it is a valid
/// text whatever is in it.
template <typename Json>
[[nodiscard]] std::string json_ascii(const Json& json) {
  return json.dump(-1, ' ', true, Json::error_handler_t::replace);
}

/// A path, which may be any bytes, as a text of JSON that says which: itself where it is a text without
/// fault, else the URI of the absolute path (RFC 8089, `file:///tmp/caf%E9`). What begins with `file:` is
/// always one.
[[nodiscard]] std::string path_in_json(const std::filesystem::path& path);

}  // namespace cairn
