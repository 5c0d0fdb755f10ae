// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>

#include "common/base/result.h"

namespace cairn {

/// The YAML of a file that an operator wrote; null for an empty one. kConfiguration names the file and, where
/// there is one, the line.
[[nodiscard]] Result<YAML::Node> load_yaml(const std::filesystem::path& path);

}  // namespace cairn
