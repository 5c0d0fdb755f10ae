// SPDX-License-Identifier: Apache-2.0
#include "common/base/configuration_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "common/base/option_yaml.h"
#include "common/base/suggestion.h"
#include "common/base/yaml_file.h"

namespace cairn {

Result<ConfigurationWords> read_configuration(const std::filesystem::path& path,
                                              const std::vector<std::string>& names,
                                              const OptionList& engines) {
  const auto loaded = load_yaml(path);
  if (!loaded) return tl::unexpected(loaded.error());
  const YAML::Node& root = *loaded;
  ConfigurationWords words;
  if (root.IsNull()) return words;
  if (!root.IsMap()) return fail(ErrorCode::kConfiguration, path.string() + ": expected `key: value` lines");
  std::set<std::string> seen;
  for (const auto& entry : root) {
    const auto refuse = [&](const std::string& why) {
      return fail(ErrorCode::kConfiguration,
                  fmt::format("{}:{}: {}", path.string(), entry.first.Mark().line + 1, why));
    };
    if (!entry.first.IsScalar()) return refuse("expected `key: value`");
    const auto key = entry.first.as<std::string>();
    if (!seen.insert(key).second) return refuse(fmt::format("'{}' is there twice", key));
    if (const OptionList* engine = engines.find_part(key)) {
      if (const Status read = read_options(entry.second, path.string(), *engine); !read)
        return tl::unexpected(read.error());
      continue;
    }
    std::vector<std::string> valid = names;
    for (const std::string& heading : engines.names()) valid.push_back(heading);
    if (std::find(names.begin(), names.end(), key) == names.end())
      return refuse(fmt::format("unknown key '{}'{}", key, did_you_mean(key, valid)));
    if (!entry.second.IsScalar()) return refuse("expected `key: value`");
    words[key] = entry.second.as<std::string>();
  }
  return words;
}

std::string write_configuration(const std::string& program, const std::vector<ConfigurationLine>& lines,
                                const OptionList& engines) {
  std::string text = fmt::format("# {} --config\n", program);
  for (const ConfigurationLine& line : lines) {
    text += line.is_set ? fmt::format("{}: {}\n", line.name, YAML::Dump(YAML::Node(line.value)))
                        : fmt::format("# {}: {}\n", line.name, line.value);
  }
  return text + write_options(engines);
}

}  // namespace cairn
