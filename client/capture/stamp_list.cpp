// SPDX-License-Identifier: Apache-2.0
#include "client/capture/stamp_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "common/io/text.h"

namespace cairn {
namespace {

constexpr std::array kUnits = {TimeUnit::kSeconds, TimeUnit::kMilliseconds, TimeUnit::kMicroseconds,
                               TimeUnit::kNanoseconds};

/// Decimals between the unit and seconds.
size_t decimals_of(TimeUnit unit) {
  return 3 * static_cast<size_t>(unit);
}

}  // namespace

Result<StampUnit> stamp_unit(const SourceUri& uri, TimeUnit otherwise) {
  const auto option = uri.options.find("unit");
  if (option == uri.options.end()) return StampUnit{otherwise, false};
  for (const TimeUnit unit : kUnits) {
    if (short_name(unit) == option->second) return StampUnit{unit, true};
  }
  return fail(ErrorCode::kUsage, "source option unit=" + option->second + ": there are s, ms, us and ns");
}

std::optional<Timestamp> parse_stamp(std::string_view text, TimeUnit unit) {
  if (unit == TimeUnit::kSeconds) return parse_timestamp(text);
  const bool is_negative = text.starts_with('-');
  if (is_negative) text.remove_prefix(1);
  if (text.find_first_not_of("0123456789.") != std::string_view::npos) return std::nullopt;
  const size_t point = std::min(text.find('.'), text.size());
  if (point == 0 || (unit == TimeUnit::kNanoseconds && point < text.size())) return std::nullopt;
  // The point moves to the left, so that no digit is lost in a double.
  const size_t decimals = decimals_of(unit);
  const size_t zeros = point > decimals ? 0 : decimals + 1 - point;
  const std::string digits = std::string(zeros, '0') + std::string(text.substr(0, point));
  const size_t whole = digits.size() - decimals;
  const auto fraction = point < text.size() ? text.substr(point + 1) : std::string_view();
  return parse_timestamp(fmt::format("{}{}.{}{}", is_negative ? "-" : "", digits.substr(0, whole),
                                     digits.substr(whole), fraction));
}

std::string other_unit_hint(std::string_view text, TimeUnit unit) {
  constexpr double kEarliest = 9e8;  // seconds since 1970: July 1998
  constexpr double kLatest = 4e9;
  for (const TimeUnit other : kUnits) {
    const auto time = other == unit ? std::nullopt : parse_stamp(text, other);
    if (!time || time->seconds() < kEarliest || time->seconds() > kLatest) continue;
    return fmt::format("; as {} it would be a time of our years: add unit={} to the source", long_name(other),
                       short_name(other));
  }
  return "";
}

Result<std::vector<Timestamp>> read_times(const std::filesystem::path& path, TimeUnit unit) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<Timestamp> times;
  for (const auto& line : table_rows(*content)) {
    const auto time = parse_stamp(line.text, unit);
    if (!time) {
      return fail(ErrorCode::kDamaged,
                  at_line(path, line.number,
                          fmt::format("{} is not one time in {}{}", in_quotes(line.text), long_name(unit),
                                      other_unit_hint(line.text, unit))));
    }
    times.push_back(*time);
  }
  if (times.empty()) return fail(ErrorCode::kDamaged, path.string() + ": no time in it");
  return times;
}

Result<std::vector<SourceNote>> vet_stamps(const std::filesystem::path& list,
                                           std::span<const Timestamp> stamps, StampUnit unit) {
  auto report = check_stamps(stamps, unit.unit);
  if (report.impossible) {
    const std::string words = *report.impossible + ": " + report.remedy;
    if (!unit.is_given) return fail(ErrorCode::kDamaged, list.string() + ": " + words);
    report.remarks = {words};
  }
  std::vector<SourceNote> notes;
  for (const auto& remark : report.remarks) notes.push_back({list.string() + ": " + remark, true});
  return notes;
}

}  // namespace cairn
