// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>

#include "common/base/time.h"
#include "common/base/token_bucket.h"
#include "common/wire/peers.h"

namespace cairn {

/// Says which tries are to be told of those who are turned away and go on trying. The first of each process
/// is, the first after a pause, and then one a minute, with how many there were meanwhile. Pure: the time is
/// handed in. One thread.
class Tries {
 public:
  static constexpr std::chrono::seconds kPause{10};
  static constexpr std::chrono::minutes kInterval{1};
  static constexpr double kMostAtOnce = 10;  ///< of each name: who tries may be as many processes as it likes

  /// Notes a try of `who` to be served. `process`: nothing if it is not known. Returns nothing if the try is
  /// not to be told; else how many tries have not been told since the one that was told last.
  [[nodiscard]] std::optional<size_t> note(const std::string& who, const std::optional<wire::PeerId>& process,
                                           MonotonicTime now);

 private:
  struct Known {
    MonotonicTime last;  ///< try
    MonotonicTime told;
    size_t untold = 0;
    std::set<wire::PeerId> processes;
    TokenBucket limit{kMostAtOnce / std::chrono::seconds(kInterval).count(), kMostAtOnce};
  };
  std::map<std::string, Known> known_;
};

}  // namespace cairn
