// SPDX-License-Identifier: Apache-2.0
#include "common/io/json_text.h"

#include <string_view>
#include <system_error>

#include "common/base/utf8.h"

namespace cairn {
namespace {

/// Whether a byte stands for itself in a URI's path: the unreserved characters of RFC 3986, and the slash.
bool stays_in_uri(unsigned char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
         std::string_view("-._~/").find(static_cast<char>(c)) != std::string_view::npos;
}

}  // namespace

std::string path_in_json(const std::filesystem::path& path) {
  const std::string& bytes = path.native();
  if (!fault_of_text(bytes) && !bytes.starts_with("file:")) return bytes;
  std::error_code ignored;
  const auto absolute = std::filesystem::absolute(path, ignored);
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string uri = "file://";
  for (const char c : (ignored ? path : absolute).native()) {
    const auto byte = static_cast<unsigned char>(c);
    if (stays_in_uri(byte)) {
      uri += c;
    } else {
      uri += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
    }
  }
  return uri;
}

}  // namespace cairn
