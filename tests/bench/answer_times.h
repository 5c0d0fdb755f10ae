// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>
#include <string>
#include <vector>

#include "server/relocalization/relocalizer.h"
#include "tests/bench/timing.h"

namespace cairn {

/// How long answers of the improved method take, by what they needed: the keyframes that look most alike
/// (stage A) or, when none of these is confirmed, words too (stage B).
class AnswerTimes {
 public:
  /// `tried`: candidates of the answer. CPU time.
  void add(size_t tried, double ms) {
    const bool is_early = tried <= static_cast<size_t>(RelocOptions().by_image_alone);
    (is_early ? by_image_ : by_words_).push_back(ms);
  }
  void add(const AnswerTimes& other) {
    by_image_.insert(by_image_.end(), other.by_image_.begin(), other.by_image_.end());
    by_words_.insert(by_words_.end(), other.by_words_.begin(), other.by_words_.end());
  }

  [[nodiscard]] std::vector<double> all() const {
    std::vector<double> both = by_image_;
    both.insert(both.end(), by_words_.begin(), by_words_.end());
    return both;
  }
  [[nodiscard]] const std::vector<double>& by_image() const { return by_image_; }
  [[nodiscard]] const std::vector<double>& by_words() const { return by_words_; }
  [[nodiscard]] std::string text() const {
    const auto row = [](const char* what, const std::vector<double>& ms) {
      return fmt::format("{} {} p50 {:.2f} p95 {:.2f} ms", what, ms.size(), percentile(ms, 0.5),
                         percentile(ms, 0.95));
    };
    return fmt::format("{}; {}; {}", row("answers", all()), row("by images", by_image_),
                       row("with words", by_words_));
  }

 private:
  std::vector<double> by_image_;
  std::vector<double> by_words_;
};

}  // namespace cairn
