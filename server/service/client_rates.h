// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "common/base/time.h"
#include "common/base/token_bucket.h"

namespace cairn {

/// What one client may send in the long run [1/s]; 0: as much as it likes. Far above what trackers need, also
/// when they send all that they kept while they were cut off.
struct RateLimits {
  double keyframes = 5;
  double queries = 20;
};

/// Sees to it that a client which sends far more than any tracker does costs the server little: what is
/// beyond is refused with the reason, unlooked at, and what is far beyond is not answered either. A tracker
/// sends again what is not answered. Used from one thread.
class ClientRates {
 public:
  enum class Kind : uint8_t { kState, kSeed, kKeyframe, kQuery, kRequest };
  enum class Judgement : uint8_t { kTake, kRefuse, kPassOver };

  explicit ClientRates(const RateLimits& limits);

  /// `lockstep`: a replay does not go by this clock, and the service says itself where it serves none.
  [[nodiscard]] Judgement judge(Kind kind, MonotonicTime now, bool lockstep = false);
  /// Why what is beyond the limit is refused, for a person.
  [[nodiscard]] std::string why(Kind kind) const;

 private:
  static constexpr size_t kKinds = 5;
  RateLimits limits_;
  std::array<TokenBucket, kKinds> taken_;
  TokenBucket refusals_;
};

}  // namespace cairn
