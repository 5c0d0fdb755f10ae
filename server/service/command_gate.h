// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <vector>

#include "common/wire/messages.h"

namespace cairn {

/// Sees to it that each command of a topic (keyframe offers, requests) of a client is judged once, in order,
/// and that no client has more of them in flight than its credit. `Verdict`: the topic that answers. Clients
/// send again what has no decision; the middleware may repeat a history or lose what was sent before both
/// sides had matched. A gate that does not know all of a session (it was made anew, or restored without what
/// was refused) goes on with the lowest number that the client sends, once it has sent it again and again:
/// nothing before that is wanted. One that comes late, and not again, does not count. Pure. One per client;
/// used from one thread.
template <typename Verdict>
class CommandGate {
 public:
  using Outcome = typename decltype(Verdict::recent)::value_type;

  static constexpr uint32_t kCredit = 4;
  static constexpr uint32_t kMaxAhead = 4 * kCredit;  ///< beyond the last decided: no more are taken in
  static constexpr int kSentAgain = 3;                ///< times, before a number is believed to be the lowest
  static constexpr int kSentOften = 12;  ///< likewise, once something was taken in: more than loss may hide
  static constexpr size_t kRecent = wire::kMaxOutcomes;  ///< decisions kept in the verdict

  enum class Admission : uint8_t {
    kNew,       ///< to be judged; exactly one decide() must follow
    kRepeated,  ///< already decided: the verdict should be written again
    kInFlight,  ///< being judged
    kGap,       ///< an earlier one has not come, or too many wait: the client will send it again
    kNoCredit,  ///< counts as new, to be decided as busy
  };

  /// A new session begins counting anew; what is still being judged for the old one is forgotten.
  void enter_session(SessionId session);
  /// Goes on with a session from before a restart, of which these commands (ascending) had been decided. What
  /// is missing among them is judged when it comes; what lies a credit before the last was known to the
  /// client.
  void resume(SessionId session, std::vector<Outcome> decided);
  [[nodiscard]] SessionId session() const { return session_; }

  /// Whether to judge command `seq` of the present session.
  [[nodiscard]] Admission admit(uint64_t seq);
  /// The decision on an admitted command, in any order; those of an older session are passed over.
  void decide(SessionId session, Outcome outcome);

  /// The state to publish.
  [[nodiscard]] Verdict verdict(ClientId client) const;

 private:
  /// Whether `seq`, before which something is missing, is the lowest that the client sends, again and again:
  /// what lies before it has been decided then, whatever is known of that here.
  [[nodiscard]] bool is_lowest_wanted(uint64_t seq);
  /// Moves decisions to the recent ones that were ahead of others and are no longer.
  void close_ranks();

  SessionId session_;
  uint64_t lowest_seen_ = 0;  ///< of those before which something is missing
  int times_seen_ = 0;        ///< the lowest
  int seen_since_ = 0;        ///< others than the lowest, since that was seen
  bool has_admitted_ = false;
  uint64_t last_admitted_ = 0;
  uint64_t last_decided_ = 0;
  std::map<uint64_t, Outcome> decided_ahead_;  ///< while an earlier one is being judged
  std::deque<Outcome> recent_;
};

using OfferGate = CommandGate<wire::OfferVerdict>;
using RequestGate = CommandGate<wire::ClientReply>;

/// The gate for seeds, of which a client has one at a time: a later one supersedes it. Pure.
class SeedGate {
 public:
  enum class Admission : uint8_t { kNew, kRepeated, kInFlight, kSuperseded };

  void enter_session(SessionId session);
  /// Takes up the last seed that was accepted before a restart, as CommandGate::resume() does.
  void resume(const wire::SeedVerdict& verdict);
  [[nodiscard]] Admission admit(uint64_t seq);
  /// The verdict on an admitted seed. True if it is still the newest one, that is, to be published.
  [[nodiscard]] bool decide(const wire::SeedVerdict& verdict);
  /// The last verdict; its seq is 0 before the first.
  [[nodiscard]] const wire::SeedVerdict& verdict() const { return verdict_; }

 private:
  SessionId session_;
  uint64_t newest_ = 0;
  wire::SeedVerdict verdict_;
};

}  // namespace cairn
