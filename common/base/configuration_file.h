// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/base/option_list.h"
#include "common/base/result.h"

namespace cairn {

/// Values as words, by the name of the long option of the command line.
using ConfigurationWords = std::map<std::string, std::string>;

/// What a configuration file says: a line `NAME: value` for long options, of which `names` are valid, and the
/// options of the engines as mappings under their headings, which are the parts of `engines` and are set.
/// kConfiguration names file, line and key, and the nearest valid name of a key that is unknown.
[[nodiscard]] Result<ConfigurationWords> read_configuration(const std::filesystem::path& path,
                                                            const std::vector<std::string>& names,
                                                            const OptionList& engines);

/// One long option as --print-config tells it.
struct ConfigurationLine {
  std::string name;
  std::string value;
  bool is_set = true;  ///< else `value` is a word on what holds instead, and the line a comment
};
/// A file from which read_configuration() reads the same.
[[nodiscard]] std::string write_configuration(const std::string& program,
                                              const std::vector<ConfigurationLine>& lines,
                                              const OptionList& engines);

}  // namespace cairn
