// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/text_entry.h"

#include <algorithm>
#include <array>
#include <string_view>

#include "common/base/utf8.h"
#include "common/map/label.h"

namespace cairn {
namespace {

constexpr std::array<std::string_view, 4> kRows = {"1234567890", "qwertyuiop", "asdfghjkl-", "zxcvbnm,._"};
constexpr int kColumns = 10;

constexpr int kUnicodeKey = 0x01000000;  ///< X: the keysym of a character without an older one

/// The capital of an ASCII letter, for the drawn keyboard. All other characters stay as they come.
char32_t capital(char32_t c) {
  return c >= U'a' && c <= U'z' ? c - U'a' + U'A' : c;
}

}  // namespace

std::optional<EntryStroke> stroke_of(int key_code) {
  switch (key_code) {
    case '\b':
    case 0x7f:
    case 0xff08:  // X11's BackSpace
      return EntryStroke{EntryKey::kErase};
    case 0x1b:
    case 0xff1b:
      return EntryStroke{EntryKey::kCancel};
    case '\n':
    case '\r':
    case 0xff0d:
    case 0xff8d:  // of the number pad
      return EntryStroke{EntryKey::kAccept};
    default:
      break;
  }
  const bool has_older_keysym =
      (key_code >= 0x20 && key_code <= 0x7e) || (key_code >= 0xa0 && key_code <= 0xff);
  if (!has_older_keysym && key_code < kUnicodeKey + 0x100) return std::nullopt;
  const auto character = static_cast<char32_t>(has_older_keysym ? key_code : key_code - kUnicodeKey);
  if (to_utf8(character).empty()) return std::nullopt;
  return EntryStroke{EntryKey::kCharacter, character};
}

int key_code_of(char32_t character) {
  const int value = static_cast<int>(character);
  return value <= 0xff ? value : kUnicodeKey + value;
}

void TextEntry::press(EntryStroke stroke) {
  if (state_ != State::kTyping) return;
  switch (stroke.key) {
    case EntryKey::kCharacter: {
      const std::string longer = text_ + to_utf8(shifted_ ? capital(stroke.character) : stroke.character);
      if (longer.size() > kMaxLabelBytes || fault_of_text(longer)) return;
      text_ = longer;
      shifted_ = false;
      return;
    }
    case EntryKey::kShift:
      shifted_ = !shifted_;
      return;
    case EntryKey::kErase:
      if (!text_.empty()) text_.resize(text_.size() - letters(text_).back().size());
      return;
    case EntryKey::kCancel:
      state_ = State::kCancelled;
      return;
    case EntryKey::kAccept:
      if (!is_invisible(text_)) state_ = State::kAccepted;
      return;
  }
}

std::vector<DrawnKey> lay_out_keyboard(cv::Size image, bool shifted) {
  const int rows = static_cast<int>(kRows.size()) + 1;
  const int height = image.height / 2 / rows;
  const int top = image.height - rows * height;
  const auto edge = [&](int column) { return column * image.width / kColumns; };
  const auto place = [&](int row, int from, int to) {
    return cv::Rect(edge(from), top + row * height, edge(to) - edge(from), height);
  };
  std::vector<DrawnKey> keys;
  for (int row = 0; row + 1 < rows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const auto key = static_cast<char32_t>(kRows[static_cast<size_t>(row)][static_cast<size_t>(column)]);
      keys.push_back({place(row, column, column + 1),
                      to_utf8(shifted ? capital(key) : key),
                      {EntryKey::kCharacter, key}});
    }
  }
  const int last = rows - 1;
  keys.push_back({place(last, 0, 2), "Shift", {EntryKey::kShift}});
  keys.push_back({place(last, 2, 5), "Space", {EntryKey::kCharacter, U' '}});
  keys.push_back({place(last, 5, 7), "Erase", {EntryKey::kErase}});
  keys.push_back({place(last, 7, 9), "Cancel", {EntryKey::kCancel}});
  keys.push_back({place(last, 9, 10), "OK", {EntryKey::kAccept}});
  return keys;
}

std::optional<EntryStroke> stroke_at(const std::vector<DrawnKey>& keys, cv::Point point) {
  const auto hit = std::find_if(keys.begin(), keys.end(),
                                [point](const DrawnKey& key) { return key.place.contains(point); });
  if (hit == keys.end()) return std::nullopt;
  return hit->stroke;
}

}  // namespace cairn
