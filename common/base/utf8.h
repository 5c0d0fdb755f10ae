// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Text that people read: names, labels, messages. It is UTF-8 from end to end. What comes from outside is
/// checked where it comes in (fault_of_text); what may be anything (a path is bytes) is made safe where it is
/// shown (one_line). All functions take any bytes; one that belongs to no UTF-8 counts as a letter by itself.
namespace cairn {

/// Why `text` may not be kept, sent or shown as it is, with the place; nothing: it may. Refused are bytes
/// that are no UTF-8, control characters (line breaks, C1), and what cannot be seen or turns the text around
/// it: bidirectional controls, characters without width, line separators. The joiners U+200C and U+200D are
/// taken behind a letter beyond ASCII, where Persian, the scripts of India and emoji need them.
[[nodiscard]] std::optional<std::string> fault_of_text(std::string_view text);

/// Any bytes as a terminal, a log and the wire take them: a text without fault. An ASCII control character
/// becomes a blank, a byte that is no UTF-8 `\xe9`, another character that fault_of_text refuses `\u202e`.
[[nodiscard]] std::string one_line(std::string_view text);

/// A text of several lines made safe in the same way: its line breaks stay.
[[nodiscard]] std::string many_lines(std::string_view text);

/// Whether nothing in the text can be seen: blanks of any kind.
[[nodiscard]] bool is_invisible(std::string_view text);

/// The letters as a reader counts them: a character with the marks and joined characters that follow it.
[[nodiscard]] std::vector<std::string_view> letters(std::string_view text);

/// The longest beginning of the text that is whole letters and fits into `max_bytes`. If the first letter
/// alone is longer, as many of its characters as fit.
[[nodiscard]] std::string_view cut_text(std::string_view text, size_t max_bytes);

/// Columns of a terminal: 2 for wide (East Asian) characters, 0 for combining ones.
[[nodiscard]] size_t text_width(std::string_view text);

/// The text with blanks behind it, up to `columns` of a terminal; a wider text stays as it is.
[[nodiscard]] std::string padded(std::string text, size_t columns);

/// The characters of `text`; U+FFFD for a byte that is no UTF-8.
[[nodiscard]] std::u32string code_points(std::string_view text);

/// A Unicode scalar value as UTF-8; empty for what is none.
[[nodiscard]] std::string to_utf8(char32_t character);

}  // namespace cairn
