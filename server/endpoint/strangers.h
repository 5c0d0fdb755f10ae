// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/base/time.h"

namespace cairn {

/// Peers that have announced themselves and of whom nothing else is heard: in a secured site, since they have
/// shown no keys, of which the middleware says nothing. Pure: the time is handed in. Used from one thread.
class Strangers {
 public:
  /// Who has keys has shown them by then, on a busy machine, too.
  static constexpr std::chrono::seconds kPatience{5};
  static constexpr size_t kMost = 1000;  ///< at a time; anybody may announce as many as he likes

  /// `says`: of itself.
  void came(uint64_t participant, std::string says, MonotonicTime now);
  /// The middleware has let it in; that may be heard before it is heard that it came.
  void is_let_in(uint64_t participant) {
    waiting_.erase(participant);
    let_in_.insert(participant);
  }
  void gone(uint64_t participant);
  /// Those who have shown nothing for that long, or have gone before; each once. Who goes soon, or is not
  /// heard any more, may have keys all the same.
  struct Told {
    std::string says;  ///< of itself
    bool has_left = false;
    MonotonicTime came;
    bool operator==(const Told&) const = default;
  };
  [[nodiscard]] std::vector<Told> take(MonotonicTime now);

 private:
  struct Stranger {
    std::string says;
    MonotonicTime came;
  };
  std::map<uint64_t, Stranger> waiting_;
  std::set<uint64_t> let_in_;  ///< and still there
  std::vector<Told> left_;
};

}  // namespace cairn
