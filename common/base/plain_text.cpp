// SPDX-License-Identifier: Apache-2.0
#include "common/base/plain_text.h"

#include <algorithm>

namespace cairn {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kUtf8Mark = "\xef\xbb\xbf"sv;

/// The name that iconv has for it, by the byte order mark or by the halves of the first letters that are 0;
/// empty for a text of bytes.
std::string_view wide_encoding(std::string_view bytes) {
  if (bytes.starts_with("\xff\xfe\0\0"sv) || bytes.starts_with("\0\0\xfe\xff"sv)) return "UTF-32";
  if (bytes.starts_with("\xff\xfe"sv) || bytes.starts_with("\xfe\xff"sv)) return "UTF-16";
  if (bytes.size() < 4) return {};
  const bool low_first = bytes[0] != '\0' && bytes[1] == '\0' && bytes[2] != '\0' && bytes[3] == '\0';
  const bool high_first = bytes[0] == '\0' && bytes[1] != '\0' && bytes[2] == '\0' && bytes[3] != '\0';
  return low_first ? "UTF-16LE" : high_first ? "UTF-16BE" : std::string_view();
}

}  // namespace

Result<std::string> plain_text(std::string bytes, std::string_view name) {
  const std::string file(name);
  if (const auto encoding = wide_encoding(bytes); !encoding.empty()) {
    return fail(ErrorCode::kDamaged, file + ": is " + std::string(encoding.substr(0, 6)) +
                                         " text; save it as UTF-8, or: iconv -f " + std::string(encoding) +
                                         " -t UTF-8 " + file + " > NEW");
  }
  if (bytes.find('\0') != std::string::npos) {
    return fail(ErrorCode::kDamaged, file + ": is not text: bytes of value 0 are in it");
  }
  if (bytes.starts_with(kUtf8Mark)) bytes.erase(0, kUtf8Mark.size());
  if (bytes.find('\n') == std::string::npos) std::replace(bytes.begin(), bytes.end(), '\r', '\n');
  return bytes;
}

}  // namespace cairn
