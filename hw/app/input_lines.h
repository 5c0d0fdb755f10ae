// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>
#include <unistd.h>

#include <array>
#include <optional>
#include <string>

namespace cairn {

/// Lines of stdin, without waiting for any.
class InputLines {
 public:
  /// The next line, if a whole one is there.
  [[nodiscard]] std::optional<std::string> next() {
    read_more();
    const size_t end = text_.find('\n');
    if (end == std::string::npos) return std::nullopt;
    std::string line = text_.substr(0, end);
    text_.erase(0, end + 1);
    return line;
  }

  /// Whether stdin has ended, or has more to say than kMost bytes at once: no more is read. Whole lines that
  /// were read are still given.
  [[nodiscard]] bool has_ended() const { return ended_; }

 private:
  void read_more() {
    pollfd ready{STDIN_FILENO, POLLIN, 0};
    while (!ended_ && poll(&ready, 1, 0) == 1) {
      std::array<char, 256> piece{};
      const ssize_t size = read(STDIN_FILENO, piece.data(), piece.size());
      if (size <= 0 || text_.size() > kMost) ended_ = true;
      if (size > 0) text_.append(piece.data(), static_cast<size_t>(size));
    }
  }
  static constexpr size_t kMost = 4096;
  std::string text_;
  bool ended_ = false;
};

}  // namespace cairn
