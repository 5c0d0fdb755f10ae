// SPDX-License-Identifier: Apache-2.0
#include "client/capture/source_uri.h"

#include <algorithm>

#include "common/io/text.h"

namespace cairn {
namespace {

Result<std::map<std::string, std::string>> parse_options(std::string_view text) {
  std::map<std::string, std::string> options;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = std::min(text.find('&', begin), text.size());
    const auto option = text.substr(begin, end - begin);
    const size_t equals = option.find('=');
    if (equals == 0 || equals == std::string_view::npos || equals + 1 == option.size()) {
      return fail(ErrorCode::kUsage, "source option " + in_quotes(option) + " is not of the form key=value");
    }
    const auto [at, is_new] = options.emplace(option.substr(0, equals), option.substr(equals + 1));
    if (!is_new) return fail(ErrorCode::kUsage, "source option '" + at->first + "' is given twice");
    begin = end + 1;
  }
  return options;
}

/// Place of the '?' that begins the options; the size of the text where there is none. Where no '?' has a
/// word and '=' behind it, it is the last one, so that an error names what is behind that.
size_t begin_of_options(std::string_view text) {
  constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyz_";
  for (size_t at = text.find('?'); at != std::string_view::npos; at = text.find('?', at + 1)) {
    const size_t end = text.find_first_not_of(kLetters, at + 1);
    if (end != std::string_view::npos && end > at + 1 && text[end] == '=') return at;
  }
  return std::min(text.rfind('?'), text.size());
}

}  // namespace

Result<SourceUri> parse_source_uri(std::string_view text) {
  const size_t colon = text.find(':');
  const size_t question = begin_of_options(text);
  if (colon == 0 || colon == std::string_view::npos || colon + 1 >= question) {
    return fail(ErrorCode::kUsage, "source " + in_quotes(text) + " is not of the form scheme:path?key=value");
  }
  SourceUri uri{
      std::string(text.substr(0, colon)), std::string(text.substr(colon + 1, question - colon - 1)), {}};
  if (question < text.size()) {
    auto options = parse_options(text.substr(question + 1));
    if (!options) return tl::unexpected(options.error());
    uri.options = std::move(*options);
  }
  return uri;
}

Status SourceUri::check_options(std::initializer_list<std::string_view> valid) const {
  for (const auto& [key, value] : options) {
    if (std::find(valid.begin(), valid.end(), key) != valid.end()) continue;
    std::string names;
    for (const auto name : valid) names += (names.empty() ? "" : ", ") + std::string(name);
    return fail(ErrorCode::kUsage, "source " + scheme + ": has no option '" + key + "'; " +
                                       (names.empty() ? "it takes none" : "it takes " + names));
  }
  return {};
}

Result<double> SourceUri::positive_number(const std::string& key, double fallback) const {
  const auto at = options.find(key);
  if (at == options.end()) return fallback;
  const auto number = parse_number(at->second);
  if (!number || *number <= 0) {
    return fail(ErrorCode::kUsage,
                "source option " + key + "=" + at->second + ": not a number greater than 0");
  }
  return *number;
}

}  // namespace cairn
