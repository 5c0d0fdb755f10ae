// SPDX-License-Identifier: Apache-2.0
#include "common/base/utf8.h"

#include <spdlog/fmt/fmt.h>
#include <utf8proc.h>

#include <algorithm>
#include <array>

namespace cairn {
namespace {

constexpr char32_t kNonJoiner = 0x200c;
constexpr char32_t kJoiner = 0x200d;
constexpr char32_t kReplacement = 0xfffd;

/// A character, or a byte that belongs to none.
struct Piece {
  std::string_view bytes;
  std::optional<char32_t> character;  ///< nothing: no UTF-8
};

/// The first character of a text that is not empty, or its first byte where that belongs to no UTF-8.
Piece first_piece(std::string_view text) {
  utf8proc_int32_t character = 0;
  const auto size = utf8proc_iterate(reinterpret_cast<const utf8proc_uint8_t*>(text.data()),
                                     static_cast<utf8proc_ssize_t>(text.size()), &character);
  if (size <= 0) return {text.substr(0, 1), std::nullopt};
  return {text.substr(0, static_cast<size_t>(size)), static_cast<char32_t>(character)};
}

std::vector<Piece> pieces(std::string_view text) {
  std::vector<Piece> all;
  while (!text.empty()) {
    all.push_back(first_piece(text));
    text.remove_prefix(all.back().bytes.size());
  }
  return all;
}

const utf8proc_property_t& property_of(char32_t character) {
  return *utf8proc_get_property(static_cast<utf8proc_int32_t>(character));
}

bool is_mark(utf8proc_propval_t category) {
  return category == UTF8PROC_CATEGORY_MN || category == UTF8PROC_CATEGORY_MC ||
         category == UTF8PROC_CATEGORY_ME;
}

bool is_joiner(char32_t character) {
  return character == kJoiner || character == kNonJoiner;
}

/// `before`: the character in front; 0 for none.
bool may_be_shown(char32_t character, char32_t before) {
  if (is_joiner(character)) return before > 0x7f && !is_joiner(before);
  const utf8proc_property_t& property = property_of(character);
  switch (property.category) {
    case UTF8PROC_CATEGORY_CC:
    case UTF8PROC_CATEGORY_CF:
    case UTF8PROC_CATEGORY_CS:
    case UTF8PROC_CATEGORY_ZL:
    case UTF8PROC_CATEGORY_ZP:
      return false;
    default:
      // Marks that are ignorable choose between two shapes of the character in front.
      return property.ignorable == 0 || is_mark(property.category);
  }
}

bool is_ascii_control(char32_t character) {
  return character < 0x20 || character == 0x7f;
}

std::string escaped(const Piece& piece) {
  if (!piece.character) return fmt::format("\\x{:02x}", static_cast<unsigned char>(piece.bytes.front()));
  if (is_ascii_control(*piece.character)) return " ";
  const auto value = static_cast<uint32_t>(*piece.character);
  return value > 0xffff ? fmt::format("\\U{:08x}", value) : fmt::format("\\u{:04x}", value);
}

/// Calls `visit(piece, fits)` for each; `fits`: it may stand there.
template <typename Visit>
void check_each(std::string_view text, Visit visit) {
  char32_t before = 0;
  while (!text.empty()) {
    const Piece piece = first_piece(text);
    const bool fits = piece.character && may_be_shown(*piece.character, before);
    visit(piece, fits);
    before = fits ? *piece.character : 0;  // what is shown in place of another is ASCII
    text.remove_prefix(piece.bytes.size());
  }
}

}  // namespace

std::optional<std::string> fault_of_text(std::string_view text) {
  std::optional<std::string> fault;
  check_each(text, [&](const Piece& piece, bool fits) {
    if (fits || fault) return;
    const auto place = piece.bytes.data() - text.data() + 1;
    fault = piece.character ? fmt::format("byte {} begins the character U+{:04X}, which cannot be seen",
                                          place, static_cast<uint32_t>(*piece.character))
                            : fmt::format("byte {} (0x{:02x}) is no UTF-8", place,
                                          static_cast<unsigned char>(piece.bytes.front()));
  });
  return fault;
}

std::string one_line(std::string_view text) {
  std::string shown;
  shown.reserve(text.size());
  check_each(text, [&](const Piece& piece, bool fits) {
    if (fits)
      shown += piece.bytes;
    else
      shown += escaped(piece);
  });
  return shown;
}

std::string many_lines(std::string_view text) {
  std::string shown;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = text.find('\n', begin);
    shown += one_line(text.substr(begin, end - begin));
    if (end == std::string_view::npos) break;
    shown += '\n';
    begin = end + 1;
  }
  return shown;
}

bool is_invisible(std::string_view text) {
  const auto all = pieces(text);
  return std::ranges::all_of(all, [](const Piece& piece) {
    if (!piece.character) return false;
    const auto category = property_of(*piece.character).category;
    return category == UTF8PROC_CATEGORY_ZS || category == UTF8PROC_CATEGORY_MN ||
           *piece.character == 0x2800;  // the braille cell without a dot
  });
}

std::vector<std::string_view> letters(std::string_view text) {
  std::vector<std::string_view> all;
  std::optional<char32_t> before;
  utf8proc_int32_t state = 0;
  for (const Piece& piece : pieces(text)) {
    const bool goes_on =
        before && piece.character &&
        !utf8proc_grapheme_break_stateful(static_cast<utf8proc_int32_t>(*before),
                                          static_cast<utf8proc_int32_t>(*piece.character), &state);
    if (goes_on) {
      all.back() = {all.back().data(), all.back().size() + piece.bytes.size()};
    } else {
      all.push_back(piece.bytes);
      if (!before || !piece.character) state = 0;
    }
    before = piece.character;
  }
  return all;
}

std::string_view cut_text(std::string_view text, size_t max_bytes) {
  if (text.size() <= max_bytes) return text;
  size_t end = 0;
  for (const std::string_view letter : letters(text)) {
    if (end + letter.size() > max_bytes) break;
    end += letter.size();
  }
  if (end > 0) return text.substr(0, end);
  for (const Piece& piece : pieces(text)) {
    if (end + piece.bytes.size() > max_bytes) break;
    end += piece.bytes.size();
  }
  return text.substr(0, end);
}

size_t text_width(std::string_view text) {
  size_t width = 0;
  for (const Piece& piece : pieces(text)) {
    width += piece.character
                 ? static_cast<size_t>(utf8proc_charwidth(static_cast<utf8proc_int32_t>(*piece.character)))
                 : 1;
  }
  return width;
}

std::string padded(std::string text, size_t columns) {
  const size_t width = text_width(text);
  return width < columns ? text.append(columns - width, ' ') : text;
}

std::u32string code_points(std::string_view text) {
  std::u32string all;
  for (const Piece& piece : pieces(text)) all += piece.character.value_or(kReplacement);
  return all;
}

std::string to_utf8(char32_t character) {
  const auto value = static_cast<utf8proc_int32_t>(character);
  if (!utf8proc_codepoint_valid(value)) return {};
  std::array<utf8proc_uint8_t, 4> bytes{};
  const auto size = utf8proc_encode_char(value, bytes.data());
  return {bytes.begin(), bytes.begin() + size};
}

}  // namespace cairn
