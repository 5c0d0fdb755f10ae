// SPDX-License-Identifier: Apache-2.0
#include "server/service/client_rates.h"

#include <fmt/format.h>

namespace cairn {
namespace {

// At once: all that a tracker has kept while it was without its server (SessionOptions::spool_limit), and
// more.
constexpr double kKeyframesAtOnce = 300;
constexpr double kQueriesAtOnce = 100;
// A state a frame, of cameras faster than there are and of recordings that are played as fast as can be.
constexpr double kStates = 1000;
constexpr double kStatesAtOnce = 2000;
constexpr double kSeeds = 2;
constexpr double kSeedsAtOnce = 30;
// A person with a viewer; a list of labels that is read from a file.
constexpr double kRequests = 20;
constexpr double kRequestsAtOnce = 1000;
/// Most refusals that a client is told a second in the long run, and at once; all kinds together.
constexpr double kRefusals = 10;
constexpr double kRefusalsAtOnce = 20;

}  // namespace

ClientRates::ClientRates(const RateLimits& limits)
    : limits_(limits),
      taken_{TokenBucket(kStates, kStatesAtOnce), TokenBucket(kSeeds, kSeedsAtOnce),
             TokenBucket(limits.keyframes, kKeyframesAtOnce), TokenBucket(limits.queries, kQueriesAtOnce),
             TokenBucket(kRequests, kRequestsAtOnce)},
      refusals_(kRefusals, kRefusalsAtOnce) {}

ClientRates::Judgement ClientRates::judge(Kind kind, MonotonicTime now, bool lockstep) {
  if (lockstep || taken_.at(static_cast<size_t>(kind)).take(now)) return Judgement::kTake;
  // Nobody waits for an answer to it.
  if (kind == Kind::kState) return Judgement::kPassOver;
  return refusals_.take(now) ? Judgement::kRefuse : Judgement::kPassOver;
}

std::string ClientRates::why(Kind kind) const {
  switch (kind) {
    case Kind::kKeyframe:
      return fmt::format("too many keyframes: the server takes {:g} a second of one client (--keyframe-rate)",
                         limits_.keyframes);
    case Kind::kQuery:
      return fmt::format("too many queries: the server answers {:g} a second of one client (--query-rate)",
                         limits_.queries);
    case Kind::kSeed:
      return fmt::format("too many maps begun: the server takes {:g} a second of one client", kSeeds);
    case Kind::kRequest:
      return fmt::format("too many requests: the server takes {:g} a second of one client", kRequests);
    case Kind::kState:
      break;
  }
  return fmt::format("too many states: the server takes {:g} a second of one client", kStates);
}

}  // namespace cairn
