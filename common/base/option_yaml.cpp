// SPDX-License-Identifier: Apache-2.0
#include "common/base/option_yaml.h"

#include <fmt/format.h>

#include <set>

#include "common/base/suggestion.h"

namespace cairn {
namespace {

tl::unexpected<Error> refuse(const std::string& file, const YAML::Node& at, const std::string& why) {
  return fail(ErrorCode::kConfiguration, fmt::format("{}:{}: {}", file, at.Mark().line + 1, why));
}

std::string comment(const OptionList::Row& row) {
  if (std::holds_alternative<bool*>(row.value)) return {};
  const std::string unit = row.unit.empty() ? "" : "[" + row.unit + "], ";
  return fmt::format("  # {}{} to {}", unit, row.range.least, row.range.most);
}

Status read_entry(const YAML::Node& key, const YAML::Node& value, const std::string& file,
                  const OptionList& options) {
  const auto name = key.as<std::string>();
  if (const OptionList* part = options.find_part(name)) {
    if (!value.IsMap() && !value.IsNull()) return refuse(file, key, name + ": expected options of that part");
    return read_options(value, file, *part);
  }
  const OptionList::Row* row = options.find_row(name);
  if (row == nullptr)
    return refuse(file, key, fmt::format("unknown key '{}'{}", name, did_you_mean(name, options.names())));
  if (!value.IsScalar()) return refuse(file, key, fmt::format("expected `{}: value`", name));
  if (const Status set = set_option(*row, value.as<std::string>()); !set)
    return refuse(file, key, set.error().message);
  return {};
}

}  // namespace

std::string write_options(const OptionList& options, int indent) {
  const std::string space(static_cast<size_t>(indent), ' ');
  std::string text;
  for (const OptionList::Row& row : options.rows())
    text += fmt::format("{}{}: {}{}\n", space, row.name, option_text(row), comment(row));
  for (const auto& [name, part] : options.parts())
    text += fmt::format("{}{}:\n", space, name) + write_options(part, indent + 2);
  return text;
}

Status read_options(const YAML::Node& node, const std::string& file, const OptionList& options) {
  if (node.IsNull()) return {};
  if (!node.IsMap()) return refuse(file, node, "expected `key: value` lines");
  std::set<std::string> seen;
  for (const auto& entry : node) {
    if (!entry.first.IsScalar()) return refuse(file, entry.first, "expected `key: value`");
    if (!seen.insert(entry.first.as<std::string>()).second)
      return refuse(file, entry.first, fmt::format("'{}' is there twice", entry.first.as<std::string>()));
    if (auto read = read_entry(entry.first, entry.second, file, options); !read) return read;
  }
  if (const Status checked = options.check(); !checked) return refuse(file, node, checked.error().message);
  return {};
}

}  // namespace cairn
