// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string>

namespace cairn {

/// A text of somebody else's (SQLite, an exception, a peer) as the wire and the log take it: control
/// characters, line breaks among them, become blanks.
[[nodiscard]] inline std::string one_line(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < ' ' || c == '\x7f'; },
      ' ');
  return text;
}

}  // namespace cairn
