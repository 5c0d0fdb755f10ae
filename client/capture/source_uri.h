// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace cairn {

/// `scheme:path?key=value&key=value`. The first '?' that a word and '=' follow begins the
/// options, so that there may be others in a path and in a value; nothing is percent-decoded.
struct SourceUri {
  std::string scheme;
  std::string path;
  std::map<std::string, std::string> options;

  /// kUsage unless every option is one of `valid`; the message lists them.
  [[nodiscard]] Status check_options(std::initializer_list<std::string_view> valid) const;
  /// A number greater than 0, or `fallback` where the option is not given; kUsage otherwise.
  [[nodiscard]] Result<double> positive_number(const std::string& key, double fallback) const;
};

/// Splits a `--source` argument; kUsage when scheme or path is empty, an option has no '=' or is given twice.
[[nodiscard]] Result<SourceUri> parse_source_uri(std::string_view uri);

}  // namespace cairn
