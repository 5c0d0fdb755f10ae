// SPDX-License-Identifier: Apache-2.0
#include "common/base/utc.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

namespace cairn {
namespace {

using std::chrono::sys_days;

// Of text that has_shape() says consists of digits there.
int digits(std::string_view text, size_t at, size_t count) {
  int value = 0;
  for (const char c : text.substr(at, count)) value = 10 * value + (c - '0');
  return value;
}

bool has_shape(std::string_view text, std::string_view shape) {
  if (text.size() != shape.size()) return false;
  for (size_t i = 0; i < shape.size(); ++i) {
    const bool is_digit = text[i] >= '0' && text[i] <= '9';
    if (shape[i] == '0' ? !is_digit : text[i] != shape[i]) return false;
  }
  return true;
}

}  // namespace

std::string to_utc(Timestamp time) {
  constexpr std::chrono::nanoseconds kEarliest =
      std::chrono::days(-106'751);  // a day before it would overflow
  const std::chrono::sys_time<std::chrono::nanoseconds> when{
      std::max(kEarliest, std::chrono::nanoseconds(time.nanoseconds))};
  const auto day = std::chrono::floor<std::chrono::days>(when);
  const std::chrono::year_month_day date(day);
  const std::chrono::hh_mm_ss clock(std::chrono::floor<std::chrono::seconds>(when - day));
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z", static_cast<int>(date.year()),
                     static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                     clock.hours().count(), clock.minutes().count(), clock.seconds().count());
}

Result<Timestamp> parse_utc(std::string_view text) {
  const auto refuse = [&] {
    return fail(ErrorCode::kUsage,
                fmt::format("'{}' is no time: write it as 2026-12-01 or 2026-12-01T12:00:00Z (UTC)", text));
  };
  const bool is_day = has_shape(text, "0000-00-00");
  if (!is_day && !has_shape(text, "0000-00-00T00:00:00Z")) return refuse();
  const int year = digits(text, 0, 4);
  const std::chrono::year_month_day date{std::chrono::year(year),
                                         std::chrono::month(static_cast<unsigned>(digits(text, 5, 2))),
                                         std::chrono::day(static_cast<unsigned>(digits(text, 8, 2)))};
  if (!date.ok() || year < 1970 || year > 2199) return refuse();  // an int64 of nanoseconds ends in 2262
  std::chrono::seconds since = sys_days(date).time_since_epoch();
  if (!is_day) {
    const int hours = digits(text, 11, 2);
    const int minutes = digits(text, 14, 2);
    const int seconds = digits(text, 17, 2);
    if (hours > 23 || minutes > 59 || seconds > 59) return refuse();
    since += std::chrono::hours(hours) + std::chrono::minutes(minutes) + std::chrono::seconds(seconds);
  }
  return Timestamp{std::chrono::nanoseconds(since).count()};
}

}  // namespace cairn
