// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {

/// A line of a text file, without its end ("\n" or "\r\n"). Views into the file's content.
struct TextLine {
  size_t number = 0;  ///< from 1, as editors count
  std::string_view text;
};

/// The bytes of a regular file of at most `max_bytes`. Errors name the file: kNotFound (missing), kIo (not a
/// regular file, not readable), kDamaged (larger than `max_bytes`).
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path& path,
                                            size_t max_bytes = size_t{256} << 20);

/// Reads a file that people write or other programs export: what plain_text() makes of its bytes. Errors as
/// those of read_file(), and kDamaged of plain_text().
[[nodiscard]] Result<std::string> read_text_file(const std::filesystem::path& path,
                                                 size_t max_bytes = size_t{256} << 20);

/// Whether a line has no field: spreadsheets write an empty row as commas.
[[nodiscard]] bool is_blank(std::string_view line);
/// Lines that are neither blank nor begin with '#', trimmed of blanks; each has a field. `content` must
/// outlive the result.
[[nodiscard]] std::vector<TextLine> data_lines(std::string_view content);
/// The data lines of a table, without a heading of words that no '#' marks as one (is_heading()) if more
/// follows it.
[[nodiscard]] std::vector<TextLine> table_rows(std::string_view content);
/// Whether a line names columns ("timestamp tx ty tz", "timestamp [ns],filename"): its first field is a word
/// without digits, and no field is a number.
[[nodiscard]] bool is_heading(std::string_view line);
/// All lines, trimmed of blanks. `content` must outlive the result.
[[nodiscard]] std::vector<TextLine> all_lines(std::string_view content);

/// The text without leading and trailing blanks, tabs and carriage returns.
[[nodiscard]] std::string_view trim(std::string_view text);
/// Fields between blanks, tabs or commas; never an empty one.
[[nodiscard]] std::vector<std::string_view> split_fields(std::string_view line);

/// The file that a list in `directory` names. Where none has that very name, "\\" is read as "/", as Windows
/// writes paths.
[[nodiscard]] std::filesystem::path listed_file(const std::filesystem::path& directory,
                                                std::string_view name);

/// The whole of `text` as a finite number, in the C locale.
[[nodiscard]] std::optional<double> parse_number(std::string_view text);
/// Decimal seconds, exact to the nanosecond (further digits are rounded); exponents are taken, at the
/// precision of a double.
[[nodiscard]] std::optional<Timestamp> parse_timestamp(std::string_view text);
/// Decimal seconds with 9 decimals; parse_timestamp(format_timestamp(t)) == t.
[[nodiscard]] std::string format_timestamp(Timestamp time);

/// 'text', cut to 60 bytes between letters and made safe to show (one_line): quotes of what a file or a peer
/// said, for messages.
[[nodiscard]] std::string in_quotes(std::string_view text);

/// "FILE: cannot be written: REASON" with what errno says: to be called right after the call that failed.
[[nodiscard]] std::string cannot_be_written(const std::filesystem::path& path);

/// "FILE:LINE: MESSAGE", the form that editors jump to.
[[nodiscard]] std::string at_line(const std::filesystem::path& path, size_t line, std::string_view message);

}  // namespace cairn
