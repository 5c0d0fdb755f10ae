// SPDX-License-Identifier: Apache-2.0
#include "common/io/text.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>

#include "common/base/plain_text.h"
#include "common/base/utf8.h"

namespace cairn {
namespace {

constexpr std::string_view kBlanks = " \t\r";
constexpr std::string_view kSeparators = " \t\r,";
constexpr int64_t kNanosecondsPerSecond = 1'000'000'000;

bool all_digits(std::string_view text) {
  return text.find_first_not_of("0123456789") == std::string_view::npos;
}

/// Digits after the decimal point as nanoseconds, rounded at the tenth digit.
int64_t fraction_nanoseconds(std::string_view digits) {
  int64_t nanoseconds = 0;
  for (size_t i = 0; i < 9; ++i) nanoseconds = nanoseconds * 10 + (i < digits.size() ? digits[i] - '0' : 0);
  return nanoseconds + (digits.size() > 9 && digits[9] >= '5' ? 1 : 0);
}

/// Also for "nan" and "inf", which are no words either.
bool reads_as_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error != std::errc::invalid_argument && end == text.data() + text.size();
}

}  // namespace

Result<std::string> read_file(const std::filesystem::path& path, size_t max_bytes) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) return fail(ErrorCode::kNotFound, path.string() + ": no such file");
  if (!std::filesystem::is_regular_file(status)) {
    return fail(ErrorCode::kIo, path.string() + ": not a regular file");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) return fail(ErrorCode::kIo, path.string() + ": cannot be opened: " + std::strerror(errno));
  const auto size = std::filesystem::file_size(path, error);
  if (error) return fail(ErrorCode::kIo, path.string() + ": " + error.message());
  if (size > max_bytes) {
    return fail(ErrorCode::kDamaged, path.string() + ": " + std::to_string(size) + " bytes, more than the " +
                                         std::to_string(max_bytes) + " that such a file may have");
  }
  std::string content(size, '\0');
  file.read(content.data(), static_cast<std::streamsize>(size));
  if (file.bad()) return fail(ErrorCode::kIo, path.string() + ": cannot be read: " + std::strerror(errno));
  content.resize(static_cast<size_t>(file.gcount()));
  return content;
}

Result<std::string> read_text_file(const std::filesystem::path& path, size_t max_bytes) {
  return read_file(path, max_bytes).and_then([&](std::string&& bytes) {
    return plain_text(std::move(bytes), path.string());
  });
}

std::string_view trim(std::string_view text) {
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

std::vector<TextLine> all_lines(std::string_view content) {
  std::vector<TextLine> lines;
  for (size_t begin = 0; begin < content.size();) {
    const size_t end = std::min(content.find('\n', begin), content.size());
    lines.push_back({lines.size() + 1, trim(content.substr(begin, end - begin))});
    begin = end + 1;
  }
  return lines;
}

std::vector<TextLine> data_lines(std::string_view content) {
  auto lines = all_lines(content);
  std::erase_if(lines, [](const TextLine& line) { return is_blank(line.text) || line.text.front() == '#'; });
  return lines;
}

std::vector<TextLine> table_rows(std::string_view content) {
  auto rows = data_lines(content);
  if (rows.size() > 1 && is_heading(rows.front().text)) rows.erase(rows.begin());
  return rows;
}

bool is_heading(std::string_view line) {
  const auto fields = split_fields(line);
  if (fields.empty()) return false;
  auto first = fields.front();
  if (first.starts_with('"') || first.starts_with('%')) first.remove_prefix(1);
  const bool is_word = !first.empty() && std::isalpha(static_cast<unsigned char>(first.front())) != 0 &&
                       first.find_first_of("0123456789") == std::string_view::npos;
  return is_word && !reads_as_number(first) && std::none_of(fields.begin(), fields.end(), reads_as_number);
}

bool is_blank(std::string_view line) {
  return line.find_first_not_of(kSeparators) == std::string_view::npos;
}

std::vector<std::string_view> split_fields(std::string_view line) {
  std::vector<std::string_view> fields;
  for (size_t begin = line.find_first_not_of(kSeparators); begin != std::string_view::npos;) {
    const size_t end = std::min(line.find_first_of(kSeparators, begin), line.size());
    fields.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kSeparators, end);
  }
  return fields;
}

std::filesystem::path listed_file(const std::filesystem::path& directory, std::string_view name) {
  auto file = directory / name;
  std::error_code error;
  if (name.find('\\') == std::string_view::npos || std::filesystem::exists(file, error)) return file;
  std::string slashes(name);
  std::replace(slashes.begin(), slashes.end(), '\\', '/');
  return directory / slashes;
}

std::optional<double> parse_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<Timestamp> parse_timestamp(std::string_view text) {
  // Half of what fits, so that the difference of any two fits, too.
  constexpr int64_t kMaxSeconds = std::numeric_limits<int64_t>::max() / 2 / kNanosecondsPerSecond - 1;
  if (text.find_first_of("eE") != std::string_view::npos) {
    const auto seconds = parse_number(text);
    if (!seconds || std::abs(*seconds) > static_cast<double>(kMaxSeconds)) return std::nullopt;
    return Timestamp::from_seconds(*seconds);
  }
  const bool negative = text.starts_with('-');
  if (negative) text.remove_prefix(1);
  const size_t point = std::min(text.find('.'), text.size());
  const auto whole = text.substr(0, point);
  const auto fraction = point < text.size() ? text.substr(point + 1) : std::string_view();
  if ((whole.empty() && fraction.empty()) || !all_digits(whole) || !all_digits(fraction)) return std::nullopt;
  int64_t seconds = 0;
  if (!whole.empty()) {
    const auto [end, error] = std::from_chars(whole.data(), whole.data() + whole.size(), seconds);
    if (error != std::errc() || seconds > kMaxSeconds) return std::nullopt;
  }
  const int64_t nanoseconds = seconds * kNanosecondsPerSecond + fraction_nanoseconds(fraction);
  return Timestamp{negative ? -nanoseconds : nanoseconds};
}

std::string format_timestamp(Timestamp time) {
  const bool negative = time.nanoseconds < 0;
  const uint64_t magnitude = negative ? uint64_t{0} - static_cast<uint64_t>(time.nanoseconds)
                                      : static_cast<uint64_t>(time.nanoseconds);
  std::array<char, 40> text{};
  const int length = std::snprintf(text.data(), text.size(), "%s%llu.%09llu", negative ? "-" : "",
                                   static_cast<unsigned long long>(magnitude / kNanosecondsPerSecond),
                                   static_cast<unsigned long long>(magnitude % kNanosecondsPerSecond));
  return {text.data(), static_cast<size_t>(length)};
}

std::string in_quotes(std::string_view text) {
  constexpr size_t kMaxLength = 60;
  std::string quote = "'";
  quote += one_line(cut_text(text, kMaxLength));
  quote += text.size() > kMaxLength ? "...'" : "'";
  return quote;
}

std::string cannot_be_written(const std::filesystem::path& path) {
  const int reason = errno;
  return path.string() + ": cannot be written" +
         (reason == 0 ? "" : std::string(": ") + std::strerror(reason));
}

std::string at_line(const std::filesystem::path& path, size_t line, std::string_view message) {
  return path.string() + ":" + std::to_string(line) + ": " + std::string(message);
}

}  // namespace cairn
