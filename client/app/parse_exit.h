// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace cairn {

/// The process is to end now: --help and --version (0, text for stdout), or wrong words (2, text for stderr).
struct ParseExit {
  int code = 0;
  std::string text;
};

}  // namespace cairn
