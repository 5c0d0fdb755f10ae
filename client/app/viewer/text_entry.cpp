// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/text_entry.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include "common/map/label.h"

namespace cairn {
namespace {

constexpr std::array<std::string_view, 4> kRows = {"1234567890", "qwertyuiop", "asdfghjkl-", "zxcvbnm,._"};
constexpr int kColumns = 10;

char capital(char c) {
  return static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
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
  if (key_code < 0x20 || key_code > 0x7e) return std::nullopt;
  return EntryStroke{EntryKey::kCharacter, static_cast<char>(key_code)};
}

void TextEntry::press(EntryStroke stroke) {
  if (state_ != State::kTyping) return;
  switch (stroke.key) {
    case EntryKey::kCharacter:
      if (text_.size() >= kMaxLabelBytes || stroke.character < 0x20 || stroke.character > 0x7e) return;
      text_ += shifted_ ? capital(stroke.character) : stroke.character;
      shifted_ = false;
      return;
    case EntryKey::kShift:
      shifted_ = !shifted_;
      return;
    case EntryKey::kErase:
      // Of a text from elsewhere, the last character may have several bytes.
      while (!text_.empty() && (static_cast<unsigned char>(text_.back()) & 0xc0) == 0x80) text_.pop_back();
      if (!text_.empty()) text_.pop_back();
      return;
    case EntryKey::kCancel:
      state_ = State::kCancelled;
      return;
    case EntryKey::kAccept:
      if (text_.find_first_not_of(' ') != std::string::npos) state_ = State::kAccepted;
      return;
  }
}

std::vector<DrawnKey> lay_out_keyboard(cv::Size picture, bool shifted) {
  const int rows = static_cast<int>(kRows.size()) + 1;
  const int height = picture.height / 2 / rows;
  const int top = picture.height - rows * height;
  const auto edge = [&](int column) { return column * picture.width / kColumns; };
  const auto place = [&](int row, int from, int to) {
    return cv::Rect(edge(from), top + row * height, edge(to) - edge(from), height);
  };
  std::vector<DrawnKey> keys;
  for (int row = 0; row + 1 < rows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const char c = kRows[static_cast<size_t>(row)][static_cast<size_t>(column)];
      keys.push_back({place(row, column, column + 1),
                      std::string(1, shifted ? capital(c) : c),
                      {EntryKey::kCharacter, c}});
    }
  }
  const int last = rows - 1;
  keys.push_back({place(last, 0, 2), "Shift", {EntryKey::kShift}});
  keys.push_back({place(last, 2, 5), "Space", {EntryKey::kCharacter, ' '}});
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
