// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/base/token_bucket.h"
#include "common/wire/refused_peers.h"
#include "server/endpoint/strangers.h"

namespace cairn {

/// Whom the middleware has not let in, put together of the two things that it says: that a certificate is
/// refused (by name, and not of which process), and that a process has come and is not let in (and not why).
/// Each is told at once, again once another process has come, and then once a minute; of few at a time, since
/// who tries chooses his name. Pure but for the list that is handed in: the time is, too. One thread.
class Refusals {
 public:
  /// `refused`: null: nobody says.
  explicit Refusals(std::shared_ptr<wire::RefusedPeers> refused) : refused_(std::move(refused)) {}

  /// Peers that come, are let in by the middleware, and go.
  void came(uint64_t participant, std::string says, MonotonicTime now);
  void is_let_in(uint64_t participant) { strangers_.is_let_in(participant); }
  void gone(uint64_t participant) { strangers_.gone(participant); }

  /// Peers of whom it is to be said (again) that they were not let in.
  [[nodiscard]] std::vector<wire::RefusedPeer> take(MonotonicTime now);

 private:
  struct Word {
    MonotonicTime heard;
    MonotonicTime told;
    bool is_due = true;
  };
  using Words = std::map<wire::RefusedPeer, Word>;  ///< of the last minute, and few
  void note(Words& words, wire::RefusedPeer peer, MonotonicTime now);
  /// Who was refused since then, for a person; empty: nobody.
  [[nodiscard]] std::string refused_since(MonotonicTime then) const;

  std::shared_ptr<wire::RefusedPeers> refused_;
  Strangers strangers_;
  Words of_certificates_;
  Words of_strangers_;
  std::vector<wire::RefusedPeer> told_;  ///< by the call of take() that is under way
  TokenBucket limit_{kMost / 60.0, kMost};
  static constexpr size_t kMost = 32;  ///< in a minute
};

}  // namespace cairn
