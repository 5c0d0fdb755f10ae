// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/base/result.h"

namespace cairn {

/// A file and what it is to a program: "--stats".
struct NamedFile {
  std::string role;
  std::filesystem::path path;
};

/// Whether no output is the same file as another one or as an input, by any name: links of both kinds, "./",
/// /dev/stdout. Devices (terminals, /dev/null) may be named twice. Touches nothing. Error kUsage.
[[nodiscard]] Status check_distinct(const std::vector<NamedFile>& outputs,
                                    const std::vector<NamedFile>& inputs);

}  // namespace cairn
