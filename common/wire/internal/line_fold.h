// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/rate_limit.h"

namespace cairn::wire::internal {

/// Folds what somebody else's code has to say again and again: of each place in that code a few lines in ten
/// seconds, the same one once, and then how many more there were. The time is handed in. Pure; one thread.
class LineFold {
 public:
  using TimePoint = RateLimit::TimePoint;
  static constexpr std::chrono::seconds kInterval{10};
  static constexpr size_t kLinesOfAPlace = 3;  ///< in an interval

  explicit LineFold(int lines_per_second) : lines_per_second_(lines_per_second) {}

  struct Said {
    std::string text;
    bool is_error = false;
  };
  /// Returns what to say now that a line has come, in order: those folded lines that are due, and the line
  /// itself unless it is folded.
  [[nodiscard]] std::vector<Said> take(std::string_view file, uint32_t line, Said said, TimePoint now);
  /// The lines that were folded and have not been told since.
  [[nodiscard]] std::vector<Said> rest();

 private:
  struct Place {
    RateLimit interval{kInterval};
    TimePoint begun;
    std::set<std::string> said;  ///< in this interval
    int folded = 0;              ///< since then
    Said last;
  };
  void tell_folded(Place* place, std::vector<Said>* out) const;
  [[nodiscard]] bool has_room(TimePoint now);

  const int lines_per_second_;
  std::map<std::pair<std::string, uint32_t>, Place> places_;  ///< as many as that code has
  TimePoint second_{};
  int lines_ = 0;  ///< in this second
};

}  // namespace cairn::wire::internal
