// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>

#include "common/base/option_list.h"
#include "common/base/result.h"

namespace cairn {

/// The options as YAML, `indent` spaces from the left: a line `name: value  # [unit], least to most` for
/// each, and the parts below as mappings of their own. read_options() reads the same values from it.
[[nodiscard]] std::string write_options(const OptionList& options, int indent = 0);

/// Sets the options that a mapping names; the others keep their values. Null is an empty mapping. The result
/// is checked. kConfiguration names `file`, line and key: of a key that is unknown the nearest valid name, of
/// one that is there twice, of a value that is no number or out of its range.
[[nodiscard]] Status read_options(const YAML::Node& node, const std::string& file, const OptionList& options);

}  // namespace cairn
