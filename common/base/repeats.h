// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace cairn {

/// The text without the characters that numbers are made of: texts that differ only in these are the same to
/// a reader.
[[nodiscard]] inline std::string without_numbers(std::string text) {
  std::erase_if(text, [](char c) { return (c >= '0' && c <= '9') || c == '%' || c == '.' || c == '-'; });
  return text;
}

/// Folds what would be said again and again, such as the same refusal ten times a second: said once, and
/// again after a time with how often it has come meanwhile. Pure: the time is handed in. One thread.
class Repeats {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  explicit Repeats(std::chrono::seconds interval = std::chrono::minutes(1)) : interval_(interval) {}

  /// Returns what is to be said of `text`, which has come: the text, or the text with how often it has come
  /// since it was said last. Nothing: it is folded.
  [[nodiscard]] std::optional<std::string> say(const std::string& text, TimePoint now) {
    return say(text, text, now);
  }
  /// The same for texts that differ, as by numbers, but mean the same to a reader: all of one `kind` are
  /// folded together.
  [[nodiscard]] std::optional<std::string> say(const std::string& kind, const std::string& text,
                                               TimePoint now) {
    if (known_.size() >= kMost && !known_.contains(kind)) known_.clear();
    const auto [it, is_new] = known_.try_emplace(kind, Said{text, now, 0});
    Said& said = it->second;
    if (is_new) return text;
    if (now - said.at < interval_) {
      ++said.untold;
      return std::nullopt;
    }
    const std::string words = counted(text, said.untold);
    said = {text, now, 0};
    return words;
  }

  /// The texts that were folded and have not been told since, each with its count. Forgets all texts.
  [[nodiscard]] std::vector<std::string> rest() {
    std::vector<std::string> all;
    for (const auto& [kind, said] : known_)
      if (said.untold > 0) all.push_back(counted(said.text, said.untold));
    known_.clear();
    return all;
  }

 private:
  static constexpr size_t kMost = 64;  ///< different ones; whoever chooses the words may choose many
  struct Said {
    std::string text;
    TimePoint at;
    size_t untold = 0;
  };
  static std::string counted(const std::string& text, size_t untold) {
    if (untold == 0) return text;
    return text + " (" + std::to_string(untold) + " more like it since it was said)";
  }

  std::chrono::seconds interval_;
  std::map<std::string, Said> known_;
};

}  // namespace cairn
