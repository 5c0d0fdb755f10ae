// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

/// A line of text typed by a person, on a keyboard or on one that is drawn. Pure.
namespace cairn {

/// The effect of a key on a line of text.
enum class EntryKey : uint8_t { kCharacter, kShift, kErase, kCancel, kAccept };

struct EntryStroke {
  EntryKey key = EntryKey::kCharacter;
  char32_t character = U' ';
};

/// The stroke for a key code of the window system (OpenCV's waitKeyEx); nothing: it means nothing for a line.
/// Letters are ASCII, or X's keysyms for Latin-1 and for Unicode (key_code_of).
[[nodiscard]] std::optional<EntryStroke> stroke_of(int key_code);
/// The code of a key that has this character.
[[nodiscard]] int key_code_of(char32_t character);

class TextEntry {
 public:
  enum class State : uint8_t { kTyping, kAccepted, kCancelled };

  explicit TextEntry(std::string text = {}) : text_(std::move(text)) {}

  /// Applies a key. Only a text that may be shown (fault_of_text) of at most kMaxLabelBytes can be typed, and
  /// a blank line cannot be accepted. Nothing happens any more once the line is accepted or cancelled.
  void press(EntryStroke stroke);

  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] const std::string& text() const { return text_; }
  /// The next letter will be a capital.
  [[nodiscard]] bool shifted() const { return shifted_; }

 private:
  std::string text_;
  bool shifted_ = false;
  State state_ = State::kTyping;
};

/// A key of the keyboard that is drawn.
struct DrawnKey {
  cv::Rect place;
  std::string cap;
  EntryStroke stroke;
};
/// Four rows of ten characters and one of the other keys, none over another, filling the lower part of an
/// image.
[[nodiscard]] std::vector<DrawnKey> lay_out_keyboard(cv::Size image, bool shifted);
[[nodiscard]] std::optional<EntryStroke> stroke_at(const std::vector<DrawnKey>& keys, cv::Point point);

}  // namespace cairn
